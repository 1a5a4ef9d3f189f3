//! The C structs and functions of Embree 4 that we use, opened at run time.
//!
//! One layout serves 4.0 to 4.4: since 4.3 the library also writes `inst_prim_id`, four bytes further than the structs
//! of its older headers reach, so ours always have room for it. Enumerations are plain integers, because newer
//! versions return values that older ones do not know.

use crate::foreign::{LoadError, Wanted, functions};
use std::ffi::{c_char, c_int, c_uint, c_void};
use std::sync::OnceLock;

/// No geometry, no primitive, no instance.
pub const INVALID_ID: u32 = u32::MAX;
/// `RTC_GEOMETRY_TYPE_TRIANGLE`.
pub const GEOMETRY_TRIANGLE: c_int = 0;
/// `RTC_GEOMETRY_TYPE_USER`.
pub const GEOMETRY_USER: c_int = 120;
/// `RTC_BUFFER_TYPE_INDEX`.
pub const BUFFER_INDEX: c_int = 0;
/// `RTC_BUFFER_TYPE_VERTEX`.
pub const BUFFER_VERTEX: c_int = 1;
/// `RTC_FORMAT_UINT3`.
pub const FORMAT_UINT3: c_int = 0x5003;
/// `RTC_FORMAT_FLOAT3`.
pub const FORMAT_FLOAT3: c_int = 0x9003;
/// `RTC_SCENE_FLAG_ROBUST`: no ray slips through a shared edge.
pub const SCENE_ROBUST: c_int = 4;
/// `RTC_DEVICE_PROPERTY_VERSION`.
pub const PROPERTY_VERSION: c_int = 0;

/// `RTCRay`.
#[repr(C, align(16))]
#[derive(Debug, Clone, Copy)]
pub struct RtcRay {
    pub org: [f32; 3],
    pub tnear: f32,
    pub dir: [f32; 3],
    pub time: f32,
    pub tfar: f32,
    pub mask: u32,
    pub id: u32,
    pub flags: u32,
}

/// `RTCHit` as of 4.3.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct RtcHit {
    pub ng: [f32; 3],
    pub u: f32,
    pub v: f32,
    pub prim_id: u32,
    pub geom_id: u32,
    pub inst_id: u32,
    pub inst_prim_id: u32,
}

/// `RTCRayHit` as of 4.3: 96 bytes.
#[repr(C, align(16))]
#[derive(Debug, Clone, Copy)]
pub struct RtcRayHit {
    pub ray: RtcRay,
    pub hit: RtcHit,
}

const _: () = assert!(size_of::<RtcRay>() == 48 && size_of::<RtcRayHit>() == 96 && align_of::<RtcRayHit>() == 16);

/// `RTCBounds`.
#[repr(C, align(16))]
pub struct RtcBounds {
    pub lower: [f32; 3],
    pub align0: f32,
    pub upper: [f32; 3],
    pub align1: f32,
}

/// `RTCBoundsFunctionArguments`.
#[repr(C)]
pub struct BoundsArguments {
    pub user: *const c_void,
    pub prim_id: c_uint,
    pub time_step: c_uint,
    pub bounds: *mut RtcBounds,
}

/// `RTCIntersectFunctionNArguments`; for one ray the packet has the layout of [`RtcRayHit`].
#[repr(C)]
pub struct IntersectArguments {
    pub valid: *const c_int,
    pub user: *const c_void,
    pub prim_id: c_uint,
    pub context: *const c_void,
    pub ray_hit: *mut RtcRayHit,
    pub n: c_uint,
    pub geom_id: c_uint,
}

/// `RTCOccludedFunctionNArguments`; for one ray the packet has the layout of [`RtcRay`].
#[repr(C)]
pub struct OccludedArguments {
    pub valid: *const c_int,
    pub user: *const c_void,
    pub prim_id: c_uint,
    pub context: *const c_void,
    pub ray: *mut RtcRay,
    pub n: c_uint,
    pub geom_id: c_uint,
}

/// `RTCPointQuery`. The order of the last two is that of the headers, not of the documentation.
#[repr(C, align(16))]
pub struct PointQuery {
    pub p: [f32; 3],
    pub time: f32,
    pub radius: f32,
}

/// `RTCPointQueryContext`. The stack size moved back by one word in 4.3; both places are in `tail`, which starts zero.
#[repr(C, align(16))]
pub struct PointQueryContext {
    pub world_to_instance: [f32; 16],
    pub instance_to_world: [f32; 16],
    pub inst_id: u32,
    pub tail: [u32; 7],
}

/// `RTCPointQueryFunctionArguments`.
#[repr(C, align(16))]
pub struct PointQueryArguments {
    pub query: *mut PointQuery,
    pub user: *mut c_void,
    pub prim_id: c_uint,
    pub geom_id: c_uint,
    pub context: *const PointQueryContext,
    pub similarity_scale: f32,
}

/// An opaque device, scene or geometry.
pub type Handle = *mut c_void;
/// `RTCBoundsFunction`.
pub type BoundsFunction = unsafe extern "C" fn(*const BoundsArguments);
/// `RTCIntersectFunctionN`.
pub type IntersectFunction = unsafe extern "C" fn(*const IntersectArguments);
/// `RTCOccludedFunctionN`.
pub type OccludedFunction = unsafe extern "C" fn(*const OccludedArguments);
/// `RTCPointQueryFunction`.
pub type PointQueryFunction = unsafe extern "C" fn(*mut PointQueryArguments) -> bool;

functions! {
    new_device = b"rtcNewDevice\0": fn(*const c_char) -> Handle;
    release_device = b"rtcReleaseDevice\0": fn(Handle);
    device_error = b"rtcGetDeviceError\0": fn(Handle) -> c_int;
    device_property = b"rtcGetDeviceProperty\0": fn(Handle, c_int) -> isize;
    new_scene = b"rtcNewScene\0": fn(Handle) -> Handle;
    release_scene = b"rtcReleaseScene\0": fn(Handle);
    set_scene_flags = b"rtcSetSceneFlags\0": fn(Handle, c_int);
    commit_scene = b"rtcCommitScene\0": fn(Handle);
    new_geometry = b"rtcNewGeometry\0": fn(Handle, c_int) -> Handle;
    release_geometry = b"rtcReleaseGeometry\0": fn(Handle);
    commit_geometry = b"rtcCommitGeometry\0": fn(Handle);
    attach_geometry = b"rtcAttachGeometryByID\0": fn(Handle, Handle, c_uint);
    new_buffer = b"rtcSetNewGeometryBuffer\0": fn(Handle, c_int, c_uint, c_int, usize, usize) -> *mut c_void;
    set_primitive_count = b"rtcSetGeometryUserPrimitiveCount\0": fn(Handle, c_uint);
    set_user_data = b"rtcSetGeometryUserData\0": fn(Handle, *const c_void);
    set_bounds = b"rtcSetGeometryBoundsFunction\0": fn(Handle, Option<BoundsFunction>, *const c_void);
    set_intersect = b"rtcSetGeometryIntersectFunction\0": fn(Handle, Option<IntersectFunction>);
    set_occluded = b"rtcSetGeometryOccludedFunction\0": fn(Handle, Option<OccludedFunction>);
    intersect1 = b"rtcIntersect1\0": fn(Handle, *mut RtcRayHit, *const c_void);
    occluded1 = b"rtcOccluded1\0": fn(Handle, *mut RtcRay, *const c_void);
    point_query = b"rtcPointQuery\0":
        fn(Handle, *mut PointQuery, *mut PointQueryContext, Option<PointQueryFunction>, *mut c_void) -> bool;
}

#[cfg(target_os = "macos")]
const NAME: &str = "libembree4.dylib";
#[cfg(target_os = "macos")]
const LOADER_NAMES: [&str; 2] = ["libembree4.4.dylib", "libembree4.dylib"];
#[cfg(not(target_os = "macos"))]
const NAME: &str = "libembree4.so";
#[cfg(not(target_os = "macos"))]
const LOADER_NAMES: [&str; 2] = ["libembree4.so.4", "libembree4.so"];

static EMBREE: Wanted = Wanted {
    product: "Embree 4",
    file: NAME,
    prefix: "libembree4",
    loader_names: &LOADER_NAMES,
    variable: "EMBREE_DIR",
    project_folder: ".embree",
    usual_folders: &[
        "/usr/local/lib",
        "/usr/lib",
        "/usr/lib64",
        "/opt/homebrew/lib",
        "/opt/embree/lib",
        "/opt/local/lib",
    ],
    install: "run ./bootstrap.sh in the source folder",
    repair: "remove it and run ./bootstrap.sh in the source folder",
};

/// The library, opened at the first call and never closed.
///
/// # Errors
/// Where no usable library is found; the same answer every time.
pub fn functions() -> Result<&'static Functions, LoadError> {
    static FUNCTIONS: OnceLock<Result<Functions, LoadError>> = OnceLock::new();
    FUNCTIONS.get_or_init(|| EMBREE.open(Functions::resolve)).as_ref().map_err(Clone::clone)
}
