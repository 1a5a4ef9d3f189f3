//! `curlsmoke watch`.

use crate::cli::args::InspectArguments;
use crate::cli::frames::start_threads;
use crate::cli::render::scene_of_watch;
use crate::cli::signals::Signals;
use crate::cli::values::{Crop, Display, Resolution};
use crate::cli::{log, print_result};
use crate::error::Error;
use crate::render::film::PixelBounds;
use crate::watch::board::Board;
use crate::watch::tev::Tev;
use crate::watch::{Event, Watch, server};
use clap::Args;
use std::sync::Arc;

/// Flags of `watch`.
#[derive(Debug, Args)]
pub struct WatchArguments {
    /// Flags shared by verbs that look at one frame.
    #[command(flatten)]
    pub common: InspectArguments,
    /// Show the picture on a page of this machine alone, on this port [default: 7640];
    /// 0 is any that is free. The page is served without the flag too, unless
    /// --display is there
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "7640", verbatim_doc_comment)]
    pub serve: Option<u16>,
    /// Show the picture in the viewer tev: tev, or tev=HOST:PORT
    #[arg(long, value_name = "VIEWER")]
    pub display: Option<Display>,
    /// Paths traced through each pixel at most, instead of film.spp
    #[arg(long, value_name = "COUNT")]
    pub spp: Option<u32>,
    /// Width and height in pixels, instead of film.resolution, or a share of it: 640x360, 50%
    #[arg(long, visible_alias = "res", value_name = "SIZE")]
    pub resolution: Option<Resolution>,
    /// Render a part only: x0,y0,x1,y1 in pixels from the top left, or in percent; overscan is
    /// not shown
    #[arg(long, value_name = "EDGES", allow_hyphen_values = true, verbatim_doc_comment)]
    pub crop: Option<Crop>,
}

/// Watches until a signal comes; the exit code.
pub(super) fn run(arguments: &WatchArguments) -> Result<u8, Error> {
    start_threads(arguments.common.threads)?;
    let signals = Signals::listen().map_err(|e| Error::Internal(format!("signals cannot be caught: {e}")))?;
    let path = &arguments.common.scene;
    let board = Arc::new(Board::new(arguments.common.frame));
    // Without a viewer a page is the one way to see anything.
    let port = arguments.serve.or(arguments.display.is_none().then_some(server::PORT));
    if let Some(port) = port {
        print_result(&server::serve(&board, port, |text| log(&text))?)?;
    }
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let viewer = arguments.display.as_ref().map(|display| Tev::start(display.address.clone(), name, |text| log(&text)));
    let viewer = viewer.transpose()?;
    let watch = Watch {
        path,
        load: &|| scene_of_watch(arguments),
        crop: &|size| {
            let crop = arguments.crop.map(|crop| crop.bounds(size, PixelBounds::whole(size)));
            crop.transpose().map_err(Error::Usage)
        },
        board: &board,
        show: &|picture| {
            if let Some(viewer) = &viewer {
                viewer.show(picture);
            }
        },
        is_stopped: &|| signals.received().is_some(),
        tell: &|event| log(&line(event)),
    };
    watch.run()?;
    // Watching ends in no other way.
    Ok(signals.received().map_or(0, |signal| 128 + signal))
}

/// An event as people read it.
fn line(event: &Event) -> String {
    match event {
        Event::Faulty(text) => format!("{text}\nthe last picture stays until this is mended"),
        Event::Note(text) => text.clone(),
        Event::FirstPixels { frame, made, seconds } => {
            let names: Vec<&str> = made.iter().map(|part| part.name()).collect();
            let again = if names.is_empty() { "all kept".into() } else { format!("made: {}", names.join(", ")) };
            format!("frame {frame}: first pixels after {seconds:.2} s; {again}")
        }
        Event::Finished { frame, paths, seconds } => {
            format!("frame {frame}: {paths} paths a pixel after {seconds:.1} s")
        }
    }
}
