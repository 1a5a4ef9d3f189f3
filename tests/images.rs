//! Small scenes against references: the cases of `refs/suite.yaml`, as `curlsmoke regress` runs them, each as a test.
//!
//! `make refs REASON="…"` remakes the references; a case that fails leaves its picture and a page of figures in `tests/failed/`.

use curlsmoke::output::exr::{Compression, write};
use curlsmoke::output::file::write_atomic;
use curlsmoke::output::image::Image;
use curlsmoke::progress::Silent;
use curlsmoke::regress::html::HtmlReport;
use curlsmoke::regress::{RegressJob, judge, run_case};
use curlsmoke::scene::suite::{Case, Suite};
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_path_buf()
}

fn suite() -> Suite {
    Suite::load(&root().join("refs/suite.yaml")).unwrap_or_else(|e| panic!("{e}"))
}

fn case(suite: &Suite, name: &str) -> Case {
    suite.cases().find(|(own, _)| *own == name).expect("the suite has the case").1
}

fn job() -> RegressJob {
    RegressJob { memory_limit: 1 << 30, ..RegressJob::default() }
}

/// Runs a case and demands that it passes.
fn check(name: &str) {
    let suite = suite();
    let result = run_case(&suite, name, &case(&suite, name), &job(), &Silent).unwrap_or_else(|e| panic!("{e}"));
    if result.passed() {
        return;
    }
    let page = root().join(format!("tests/failed/{name}.html"));
    let mut report = HtmlReport::new(name);
    report.add(&result).expect("pictures encode");
    write_atomic(&page, report.finish().as_bytes()).expect("writable");
    if let Ok(compared) = &result.outcome {
        let bytes = write(&compared.image, Compression::Zip).expect("encodes");
        write_atomic(&page.with_extension("exr"), &bytes).expect("writable");
    }
    panic!("{name}: {}\nseen in {}\nto accept it: {}", result.summary(), page.display(), result.update_command);
}

macro_rules! cases {
    ($($name:ident),*) => {
        $(
            #[test]
            fn $name() {
                check(stringify!($name));
            }
        )*

        #[test]
        fn every_case_of_the_suite_has_a_test() {
            let tested = [$(stringify!($name)),*];
            let suite = suite();
            let missing: Vec<&str> = suite.cases().map(|(name, _)| name).filter(|name| !tested.contains(name)).collect();
            assert!(missing.is_empty(), "add to the list above: {missing:?}");
        }
    };
}

cases!(
    thin,
    solids,
    ring_small,
    dense,
    inside,
    veil,
    sky,
    glass,
    tint,
    droplets,
    focus,
    hot,
    globe,
    parallel,
    lights,
    volumes,
    detail,
    a_per_cent_of_density_is_noticed,
    thin_with_many_paths
);

/// Whether a case still passes when its picture is changed.
fn passes_changed(name: &str, change: impl Fn(&mut Image)) -> bool {
    let suite = suite();
    let case = case(&suite, name);
    let result = run_case(&suite, name, &case, &job(), &Silent).unwrap_or_else(|e| panic!("{e}"));
    let mut compared = result.outcome.unwrap_or_else(|e| panic!("{e}"));
    change(&mut compared.image);
    judge::judge(&compared.image, &compared.reference, &case, &mut Vec::new()).expect("comparable").agree()
}

#[test]
fn a_shift_by_one_pixel_is_noticed() {
    assert!(!passes_changed("solids", |image| {
        let width = image.size[0] as usize;
        for row in image.channels.iter_mut().flat_map(|channel| channel.data.chunks_mut(width)) {
            row.rotate_right(1);
        }
    }));
}

#[test]
fn swapped_channels_are_noticed() {
    assert!(!passes_changed("solids", |image| {
        let place = |image: &Image, name: &str| image.channels.iter().position(|c| c.name == name).expect("R and B");
        let (r, b) = (place(image, "R"), place(image, "B"));
        let red = std::mem::take(&mut image.channels[r].data);
        image.channels[r].data = std::mem::replace(&mut image.channels[b].data, red);
    }));
}
