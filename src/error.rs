//! What can fail at the top: each stage's own error, and the exit code that tells scripts which kind it was.

use crate::flow::FlowError;
use crate::geometry::GeometryError;
use crate::geometry::embree::EmbreeError;
use crate::geometry::mesh_file::MeshFileError;
use crate::geometry::mesh_sdf::MeshSdfError;
use crate::grid::GridError;
use crate::grid::vdb::{VdbError, VdbProblem};
use crate::inspect::InspectError;
use crate::output::OutputError;
use crate::output::denoise::DenoiseError;
use crate::output::frames::FramesError;
use crate::output::movie::MovieError;
use crate::output::oidn::OidnError;
use crate::output::part_set::PartSetError;
use crate::particles::ParticlesError;
use crate::render::RenderError;
use crate::scene::diagnostic::Fault;
use crate::scene::pattern::PatternError;
use crate::scene::{PlaceInScene, SceneError};
use std::path::PathBuf;

/// Why a command ended early.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Shapes.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// The velocity field.
    #[error(transparent)]
    Flow(#[from] FlowError),
    /// Particles.
    #[error(transparent)]
    Particles(#[from] ParticlesError),
    /// The density grid.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// A .vdb file.
    #[error(transparent)]
    Vdb(#[from] VdbError),
    /// Light transport.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Pictures and other files.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A movie of the frames.
    #[error(transparent)]
    Movie(#[from] MovieError),
    /// Parts of a picture that do not make it.
    #[error(transparent)]
    Parts(#[from] PartSetError),
    /// Looking at the flow.
    #[error(transparent)]
    Inspect(#[from] InspectError),
    /// Denoising a picture.
    #[error("{path}: {source}", path = path.display())]
    Denoise {
        /// The picture.
        path: PathBuf,
        /// What happened.
        source: DenoiseError,
    },
    /// What a stage met, with where the scene says so.
    #[error("{place}{}{source}", frame.map(|f| format!("frame {f}: ")).unwrap_or_default())]
    InScene {
        /// Where in the scene.
        place: Box<PlaceInScene>,
        /// At which frame, where that matters.
        frame: Option<i32>,
        /// What happened.
        source: Box<Error>,
    },
    /// Lists of frames.
    #[error(transparent)]
    Frames(#[from] FramesError),
    /// A pattern for file names.
    #[error("the file name pattern `{0}`: {1}")]
    Pattern(String, PatternError),
    /// A wrong argument.
    #[error("{0}")]
    Usage(String),
    /// What was asked for is not in the scene.
    #[error("{0}")]
    NotInScene(String),
    /// A scene without smoke cannot be baked.
    #[error("the scene has no smoke; add `smoke` with `emitters` and `grid`, or `file`")]
    NothingToBake,
    /// The caller asked to stop.
    #[error("stopped; finished frames are whole, and --resume goes on from there")]
    Cancelled,
    /// A fault of the program.
    #[error("{0}; this is a fault of curlsmoke, please report it")]
    Internal(String),
}

impl Error {
    /// The program's exit code: 1 render failure, 2 usage, 3 invalid scene or input, 4 missing file, 5 output not
    /// writable, 6 over the memory limit. A signal's own code is for whoever received it to add.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Scene(e) => match e.fault() {
                Fault::Invalid => 3,
                Fault::MissingFile => 4,
                Fault::OverMemoryLimit => 6,
            },
            Error::Geometry(e) => geometry_exit_code(e),
            Error::Particles(ParticlesError::OverMemoryLimit { .. }) => 6,
            Error::Particles(ParticlesError::NotFinite { .. }) => 1,
            Error::Particles(_) | Error::Flow(_) | Error::NothingToBake | Error::NotInScene(_) => 3,
            Error::Grid(e) => grid_exit_code(e),
            Error::Vdb(e) => match &e.problem {
                VdbProblem::Io(io) if io.kind() == std::io::ErrorKind::NotFound => 4,
                VdbProblem::TooLarge { .. } => 6,
                VdbProblem::Grid { error, .. } => grid_exit_code(error),
                _ => 3,
            },
            Error::Render(e) => render_exit_code(e),
            Error::Cancelled | Error::Internal(_) => 1,
            Error::Output(e) => output_exit_code(e),
            Error::Movie(MovieError::NoFfmpeg(_))
            | Error::Denoise { source: DenoiseError::Oidn(OidnError::Load(_)), .. } => 4,
            Error::Movie(MovieError::File(e)) => output_exit_code(e),
            Error::Movie(MovieError::Name { .. }) => 2,
            Error::Movie(MovieError::Failed { .. }) => 1,
            Error::Denoise { source: DenoiseError::Oidn(_), .. } => 1,
            Error::Denoise { .. } => 3,
            Error::InScene { source, .. } => source.exit_code(),
            Error::Inspect(InspectError::OverMemoryLimit { .. }) => 6,
            Error::Inspect(_) => 3,
            Error::Frames(_) | Error::Usage(_) => 2,
            Error::Parts(_) | Error::Pattern(..) => 3,
        }
    }

    /// Whether the command ended because the caller asked it to.
    pub fn is_cancelled(&self) -> bool {
        // Stopping is no matter of any place in the scene, so it is never wrapped.
        matches!(
            self,
            Error::Cancelled
                | Error::Geometry(GeometryError::Cancelled)
                | Error::Grid(GridError::Cancelled)
                | Error::Render(RenderError::Cancelled)
                | Error::Particles(ParticlesError::Cancelled)
        )
    }
}

fn render_exit_code(e: &RenderError) -> u8 {
    match e {
        RenderError::Light { source, .. } | RenderError::Texture { source, .. } => render_exit_code(source),
        RenderError::NoLight { .. }
        | RenderError::TooDense { .. }
        | RenderError::TooHot { .. }
        | RenderError::LightNowhere { .. }
        | RenderError::CameraNowhere { .. }
        | RenderError::TooDenseForDetail { .. } => 3,
        RenderError::TexturesTooLarge { .. } => 6,
        RenderError::Picture(e) => e.downcast_ref().map_or(3, output_exit_code),
        RenderError::Geometry(e) => geometry_exit_code(e),
        RenderError::Cancelled | RenderError::NonFinite { .. } => 1,
    }
}

fn output_exit_code(e: &OutputError) -> u8 {
    match e {
        OutputError::Missing { .. } => 4,
        OutputError::Unwritable { .. } => 5,
        OutputError::TooLarge { .. } => 6,
        OutputError::Encoding { .. } => 1,
        _ => 3,
    }
}

fn grid_exit_code(e: &GridError) -> u8 {
    match e {
        GridError::OverMemory { .. } => 6,
        GridError::Cancelled => 1,
        _ => 3,
    }
}

fn geometry_exit_code(e: &GeometryError) -> u8 {
    match e {
        GeometryError::MeshFile { source: MeshFileError::NotFound { .. }, .. }
        | GeometryError::Embree(EmbreeError::Load(_)) => 4,
        GeometryError::MeshFile { source: MeshFileError::Memory { .. }, .. }
        | GeometryError::Distance { source: MeshSdfError::Memory { .. }, .. } => 6,
        GeometryError::MeshFile { .. }
        | GeometryError::Distance { .. }
        | GeometryError::Animation { .. }
        | GeometryError::Open { .. } => 3,
        GeometryError::Embree(_) | GeometryError::Cancelled => 1,
    }
}
