//! How a long computation tells its caller where it is. The library never prints: the bar belongs to the command line.

/// What the pipeline is doing. Shown to people and used as the key of the timings in the sidecar file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Stage {
    /// Reading meshes, building distances and the ray-tracing scene.
    Geometry,
    /// Moving particles to the frame; one unit is one particle step.
    Advect,
    /// Splatting particles into the grid, or reading it from a file.
    Grid,
    /// Tracing paths; one unit is one pixel sample.
    Render,
    /// Encoding and writing files.
    Write,
}

impl Stage {
    /// The stage's name as it stands in logs and sidecar files.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Geometry => "geometry",
            Stage::Advect => "advect",
            Stage::Grid => "grid",
            Stage::Render => "render",
            Stage::Write => "write",
        }
    }
}

/// Receives progress; called from any thread.
pub trait Progress: Sync {
    /// A frame begins: its number, its place in the sequence (from 0) and the number of frames.
    fn frame(&self, _frame: i32, _index: usize, _count: usize) {}
    /// A stage of the current frame begins and will take `total` units (0 when unknown).
    fn begin(&self, _stage: Stage, _total: u64) {}
    /// `units` more of the current stage are done.
    fn advance(&self, _units: u64) {}
    /// The current stage is done.
    fn end(&self, _stage: Stage) {}
    /// Something a person should know that is no error.
    fn note(&self, _text: &str) {}
    /// Files are being written besides the stage of that name: what should not be cut short.
    fn set_writing(&self, _is_writing: bool) {}
    /// True once each time somebody asked for a picture of what is done so far.
    fn takes_snapshot(&self) -> bool {
        false
    }
    /// True when the work should stop as soon as it can without leaving anything half done.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Tells nobody.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {}
