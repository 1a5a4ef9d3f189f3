//! `curlsmoke watch`.

use crate::cli::args::WatchArguments;
use crate::cli::frames::start_threads;
use crate::cli::render::scene_of_watch;
use crate::cli::signals::Signals;
use crate::cli::{log, print_result};
use crate::error::Error;
use crate::render::film::PixelBounds;
use crate::watch::board::Board;
use crate::watch::tev::Tev;
use crate::watch::{Event, Watch, server};
use std::sync::Arc;

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
