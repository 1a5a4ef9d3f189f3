//! Tables 1 and 2 and figures 3 to 10 of *Improving Curl Noise* (Bærentzen et al. 2025) with our own figures beside those
//! that were published: `make paper-tables` writes docs/paper-tables.md.

#![allow(clippy::print_stdout, reason = "what it is for")]

mod lifted;
mod points;
mod solids;
mod surfaces;
mod warps;

use curlsmoke::output::View;
use curlsmoke::output::file::write_atomic;
use curlsmoke::output::png;
use std::path::{Path, PathBuf};

/// What is written: text, and pictures beside it.
struct Report {
    folder: PathBuf,
    text: String,
}

impl Report {
    fn say(&mut self, words: &str) {
        self.text.push_str(words);
    }

    /// Writes a picture [linear colours], and its line in the text.
    fn picture(&mut self, name: &str, size: [u32; 2], rgb: &[[f32; 3]]) {
        self.file(name, &png::encode(rgb, size, View::Standard, 0.0).expect("a small picture"));
    }

    fn file(&mut self, name: &str, bytes: &[u8]) {
        let file = self.folder.join("paper").join(name);
        write_atomic(&file, bytes).expect("docs/paper/ can be written");
        self.text.push_str(&format!("<img src=\"paper/{name}\"> "));
        println!("{}", file.display());
    }
}

const INTRODUCTION: &str = "\
# Improving Curl Noise, in figures

Written by `make paper-tables`: what Bærentzen, Martínez, Frisvad and Lefebvre published in 2025, and what this program does. Times
are of the machine that the command ran on, those published of an Apple M1 Max. Figure 1 is a scene, `scenes/filaments.yaml`.

";

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    std::fs::create_dir_all(folder.join("paper")).expect("docs/paper/ can be made");
    let mut report = Report { folder, text: String::from(INTRODUCTION) };
    points::table_1(&mut report);
    warps::table_2(&mut report);
    surfaces::figure_3(&mut report);
    points::figure_4(&mut report);
    warps::figure_5(&mut report);
    surfaces::figure_6(&mut report);
    warps::figure_7(&mut report);
    surfaces::figure_7(&mut report);
    points::figure_8(&mut report);
    lifted::figure_9(&mut report);
    lifted::figure_10(&mut report);
    write_atomic(&report.folder.join("paper-tables.md"), report.text.as_bytes()).expect("docs/ can be written");
}
