//! `curlsmoke denoise`.

use crate::cli::values::Memory;
use crate::cli::{log, print_result};
use crate::error::Error;
use crate::output::View;
use crate::output::denoise::{self, DenoiseSettings};
use crate::output::exr::{self, Compression};
use crate::output::file::{check_writable, write_atomic};
use crate::output::oidn::Denoiser;
use crate::output::png;
use clap::Args;
use std::path::{Path, PathBuf};

/// Flags of `denoise`.
#[derive(Debug, Args)]
pub struct DenoiseArguments {
    /// The picture (.exr), best with layers of albedo and normal (output.aovs)
    pub image: PathBuf,
    /// The picture with a layer more: all channels of the first, and denoised.R, .G, .B
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Also a .png of the denoised colours
    #[arg(long, value_name = "FILE")]
    pub preview: Option<PathBuf>,
    /// Make R, G and B the denoised ones; those that were rendered become noisy.R, .G, .B
    #[arg(long)]
    pub replace: bool,
    /// Denoise albedo and normal first: for few paths a pixel, blur of motion or lens
    #[arg(long)]
    pub prefilter: bool,
    /// Threads [default: one for each processor]
    #[arg(short = 'j', long, value_name = "COUNT", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub threads: Option<u16>,
    /// Refuse pictures that need more memory than this [GiB], as 4, 4G or 512M
    #[arg(long, value_name = "AMOUNT", default_value = "8")]
    pub memory_limit: Memory,
}

/// Denoises; the exit code.
pub(super) fn run(arguments: &DenoiseArguments) -> Result<u8, Error> {
    let ending = |path: &Path| path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    for (what, path, wanted) in [
        ("the picture", Some(&arguments.image), "exr"),
        ("--output", Some(&arguments.output), "exr"),
        ("--preview", arguments.preview.as_ref(), "png"),
    ] {
        if let Some(path) = path.filter(|path| ending(path) != wanted) {
            return Err(Error::Usage(format!("{what} {}: the name must end in .{wanted}", path.display())));
        }
    }
    // What fails soon is tried first.
    check_writable(&arguments.output)?;
    arguments.preview.as_deref().map(check_writable).transpose()?;
    let image = exr::read(&arguments.image, arguments.memory_limit.bytes())?;
    let in_picture = |source| Error::Denoise { path: arguments.image.clone(), source };
    denoise::check(&image).map_err(in_picture)?;
    let denoiser = Denoiser::try_new(arguments.threads.map(usize::from)).map_err(|e| in_picture(e.into()))?;
    let settings = DenoiseSettings { is_prefiltered: arguments.prefilter, replaces: arguments.replace };
    let (out, guides) = denoise::denoise(&image, settings, &denoiser).map_err(in_picture)?;
    write_atomic(&arguments.output, &exr::write(&out, Compression::Zip)?)?;
    if let Some(preview) = &arguments.preview {
        let layer = if arguments.replace { "" } else { denoise::DENOISED };
        let rgb = out.to_rgb(layer).ok_or_else(|| Error::Internal("the denoised layer is missing".into()))?;
        let (size, rgb) = out.shown(&rgb);
        write_atomic(preview, &png::encode(&rgb, size, View::Standard, 0.0)?)?;
    }
    if !guides.albedo || !guides.normal {
        log("warning: edges are kept best with layers of albedo and normal: `output: {aovs: [albedo, normal]}`");
    }
    let [width, height] = out.data_size;
    let by = denoiser.version();
    let name = arguments.output.display();
    print_result(&format!("{name}: {width} × {height} pixels, Open Image Denoise {by}")).map(|()| 0)
}
