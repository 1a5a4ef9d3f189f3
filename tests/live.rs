//! What a change leaves alone is kept, and nothing of what is seen tells so: each picture of a studio that lives on equals that of
//! a fresh one, byte for byte.

use curlsmoke::grid::DensityGrid;
use curlsmoke::grid::vdb::{VdbWriteSettings, write_float_grids};
use curlsmoke::math::space::WorldPoint;
use curlsmoke::output::exr::{self, Compression};
use curlsmoke::output::image::{Image, SampleKind};
use curlsmoke::pipeline;
use curlsmoke::pipeline::inputs::Part;
use curlsmoke::pipeline::live::LiveStudio;
use curlsmoke::progress::{Progress, Silent};
use curlsmoke::render::film::{Film, PixelBounds};
use curlsmoke::scene::Scene;
use glam::UVec3;
use std::fs;
use std::io::Read;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

const SCENE: &str = "\
version: 1
frames: {first: 1, last: 4, shutter: [-0.25, 0.25]}
camera: {position: [0, 0.6, 3], look_at: [0, 0.5, 0]}
film: {resolution: [24, 16], spp: 3}
shapes:
  ball: {sphere: {center: [0.1, 0.7, 0], radius: 0.2}, material: {diffuse: {reflectance: [0.5, 0.4, 0.3]}}}
  lamp: {sphere: {center: [0.9, 0.9, 0.2], radius: 0.1}, material: {diffuse: {reflectance: [0, 0, 0], emission: [3, 2, 1]}}}
  stone: {mesh: {file: stone.obj}, transform: {translate: [-0.6, 0.2, 0]}}
flow:
  potentials:
    - uniform: {velocity: [0, 0.6, 0]}
    - noise: {length_scale: 0.4, speed: 0.3, octaves: 2}
  obstacles: [ball]
smoke:
  emitters: [{disk: {center: [0, 0.05, 0], radius: 0.2}, rate: 3000, mass: 0.03, lifetime: 1, start: -0.8}]
  grid: {voxel_size: 0.05}
  medium: {extinction: 20, albedo: [0.9, 0.9, 0.8]}
volumes:
  mist: {file: {path: mist.vdb}, medium: {extinction: 2, albedo: [0.7, 0.8, 0.9]}}
lights:
  - sun: {direction: [0.6, -0.7, 0.2], irradiance: [3, 3, 2]}
  - environment: {radiance: [0.3, 0.4, 0.5]}
output: {aovs: [depth, normal, albedo, variance, motion, transmittance, passages, samples]}
";

const TETRAHEDRON: &str = "v 0 0 0\nv 0.5 0 0\nv 0 0.5 0\nv 0 0 0.5\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

struct Desk {
    folder: tempfile::TempDir,
    studio: LiveStudio,
}

impl Desk {
    fn new() -> Self {
        let desk = Self { folder: tempfile::tempdir().unwrap(), studio: LiveStudio::default() };
        desk.write("stone.obj", TETRAHEDRON);
        desk.write_mist(0.5);
        desk
    }

    fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        // As editors save.
        let new = self.folder.path().join("new");
        fs::write(&new, text).unwrap();
        fs::rename(new, self.folder.path().join(name)).unwrap();
    }

    fn write_mist(&self, density: f32) {
        let origin = WorldPoint(glam::Vec3::new(-1.0, 0.0, -0.5));
        let grid =
            DensityGrid::from_fn(origin, 0.1, UVec3::new(20, 10, 10), 1 << 30, |p| density * p.0.y.max(0.0)).unwrap();
        self.write("mist.vdb", write_float_grids(&[("density", &grid)], VdbWriteSettings::default()));
    }

    fn scene(&self, text: &str) -> Scene {
        self.write("scene.yaml", text);
        Scene::load(&self.folder.path().join("scene.yaml")).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Takes a picture with the studio and afresh, and demands that they are equal; which parts were made again.
    #[track_caller]
    fn check(&mut self, text: &str, frame: i32, crop: Option<PixelBounds>) -> Vec<Part> {
        let scene = self.scene(text);
        let made = self.studio.prepare(&scene, frame, &Silent).unwrap();
        let mut last = None;
        self.studio.expose(&scene, frame, crop, &Silent, &mut |film, _| last = Some(film)).unwrap();
        let fresh = pipeline::film(&scene, frame, crop, &Silent).unwrap();
        let (last, fresh) = (bits(&last.unwrap()), bits(&fresh));
        let differing = last.iter().zip(&fresh).filter(|(a, b)| a != b).count();
        assert!(last == fresh, "stale: {differing} of {} numbers differ; made again: {made:?}", fresh.len());
        made
    }
}

fn bits(film: &Film) -> Vec<u32> {
    let pixels = film.pixels.iter().flat_map(|p| {
        let [mean, variance] = [p.mean, p.variance].map(|rgb| rgb.to_array());
        mean.into_iter().chain(variance).chain([p.alpha])
    });
    let b = film.bounds;
    let size = [film.spp].into_iter().chain([b.x0, b.y0, b.x1, b.y1].map(i32::cast_unsigned));
    size.chain(pixels.chain(film.layer_data.iter().copied()).map(f32::to_bits)).collect()
}

fn changed(old: &str, new: &str) -> String {
    assert!(SCENE.contains(old), "{old}");
    SCENE.replacen(old, new, 1)
}

#[test]
fn a_picture_after_a_change_is_that_of_a_fresh_start() {
    use Part::*;
    let mut desk = Desk::new();
    assert_eq!(desk.check(SCENE, 2, None), [Shapes, Surfaces, Textures, Lights, Particles, Density, Medium, Volumes]);
    assert_eq!(desk.check(SCENE, 2, None), []);
    let rows: [(&str, &str, &[Part]); 18] = [
        ("irradiance: [3, 3, 2]", "irradiance: [1, 2, 3]", &[Lights]),
        ("direction: [0.6, -0.7, 0.2]", "direction: [-0.6, -0.7, 0.2]", &[Lights]),
        ("reflectance: [0.5, 0.4, 0.3]", "reflectance: [0.1, 0.2, 0.3]", &[]),
        ("emission: [3, 2, 1]", "emission: [0, 0, 0]", &[]),
        ("position: [0, 0.6, 3]", "position: [0.5, 0.6, 3]", &[]),
        ("look_at: [0, 0.5, 0]", "look_at: [0.8, 0.9, 0]", &[]),
        ("resolution: [24, 16]", "resolution: [70, 66]", &[]),
        ("speed: 0.3", "speed: 0.6", &[Particles, Density, Medium]),
        ("obstacles: [ball]", "obstacles: [ball, stone]", &[Shapes, Surfaces, Particles, Density, Medium, Volumes]),
        ("[0.1, 0.7, 0]", "[0.15, 0.7, 0]", &[Shapes, Surfaces, Particles, Density, Medium, Volumes]),
        ("[-0.6, 0.2, 0]", "[-0.5, 0.2, 0]", &[Shapes, Surfaces, Volumes]),
        ("extinction: 20", "extinction: 40", &[Medium]),
        ("albedo: [0.9, 0.9, 0.8]", "albedo: [0.2, 0.9, 0.8]", &[Medium]),
        ("albedo: [0.9, 0.9, 0.8]", "albedo: [0.9, 0.9, 0.8]}\n  detail: {length_scale: 0.1", &[Medium]),
        (
            "albedo: [0.9, 0.9, 0.8]",
            "albedo: [0.9, 0.9, 0.8]}\n  blackbody: {temperature: 1500, cooling_time: 1",
            &[Density, Medium],
        ),
        ("albedo: [0.9, 0.9, 0.8]}", "albedo: [0.9, 0.9, 0.8]}\n  remap: {in_range: [0.1, 1]}", &[Density, Medium]),
        ("extinction: 2,", "extinction: 4,", &[Volumes]),
        ("shutter: [-0.25, 0.25]", "shutter: [0, 0]", &[Shapes, Surfaces, Lights, Particles, Density, Medium, Volumes]),
    ];
    for (old, new, parts) in rows {
        let made = desk.check(&changed(old, new), 2, None);
        assert_eq!(made, parts, "{old} -> {new}");
        // And back.
        desk.check(SCENE, 2, None);
    }
}

#[test]
fn files_frames_and_crops_are_followed() {
    use Part::*;
    let mut desk = Desk::new();
    desk.check(SCENE, 2, None);
    desk.write_mist(2.0);
    assert_eq!(desk.check(SCENE, 2, None), [Volumes]);
    desk.write("stone.obj", TETRAHEDRON.replace("0.5", "0.8"));
    let made = desk.check(SCENE, 2, None);
    assert!(made.starts_with(&[Shapes, Surfaces]), "{made:?}");
    let of_frame = [Density, Medium, Volumes];
    assert_eq!(desk.check(SCENE, 3, None), of_frame);
    assert_eq!(desk.check(SCENE, 1, None), of_frame, "backwards too");
    let crop = PixelBounds { x0: 3, y0: 5, x1: 20, y1: 11 };
    assert_eq!(desk.check(SCENE, 1, Some(crop)), []);
    // A shape that moves is placed for each frame.
    let text = changed("radius: 0.1}", "radius: 0.1}, motion: {keys: [{time: 0}, {time: 1, translate: [0, -5, 0]}]}");
    desk.check(&text, 1, None);
    assert_eq!(desk.check(&text, 4, None), [Surfaces, Density, Medium, Volumes]);
    // Smoke from a file instead.
    let file = &SCENE[SCENE.find("smoke:").unwrap()..SCENE.find("volumes:").unwrap()];
    let text = SCENE.replace(file, "smoke: {file: {path: mist.vdb}, medium: {extinction: 3, albedo: [1, 1, 1]}}\n");
    desk.check(&text, 2, None);
    desk.write_mist(1.0);
    assert_eq!(desk.check(&text, 2, None), [Density, Medium, Volumes]);
    assert_eq!(desk.check(&text.replace("speed: 0.3", "speed: 3"), 2, None), [], "nothing flows in it");
}

/// Demands equal pictures when a change comes, when only the frame changes, forwards and back, and when it goes; what was made again
/// for another frame.
#[track_caller]
fn follows(desk: &mut Desk, text: &str) -> Vec<Part> {
    desk.check(SCENE, 2, None);
    desk.check(text, 2, None);
    assert_eq!(desk.check(text, 2, None), []);
    let made = desk.check(text, 3, None);
    desk.check(text, 1, None);
    desk.check(SCENE, 1, None);
    made
}

#[test]
fn what_moves_is_followed_from_frame_to_frame() {
    use Part::*;
    let desk = &mut Desk::new();
    let position = changed("position: [0, 0.6, 3]", "position: {1: [0, 0.6, 3], 4: [1, 0.8, 2.5]}");
    assert_eq!(follows(desk, &position), [Density, Medium, Volumes]);
    let fov = changed("look_at: [0, 0.5, 0]", "look_at: [0, 0.5, 0], vertical_fov_deg: {1: 20, 4: 60}");
    assert_eq!(follows(desk, &fov), [Density, Medium, Volumes]);
    for (old, new) in [
        ("irradiance: [3, 3, 2]", "irradiance: {1: [3, 3, 2], 4: [0, 1, 5]}"),
        ("direction: [0.6, -0.7, 0.2]", "direction: {1: [0.6, -0.7, 0.2], 4: [-0.6, -0.7, 0.2]}"),
    ] {
        assert_eq!(follows(desk, &changed(old, new)), [Lights, Density, Medium, Volumes], "{new}");
    }
    for (old, new) in [
        ("translate: [-0.6, 0.2, 0]", "translate: {1: [-0.6, 0.2, 0], 4: [0.3, 0.4, 0.2]}"),
        ("translate: [-0.6, 0.2, 0]", "scale: {1: 0.5, 4: 2}"),
        ("radius: 0.1}, material", "radius: 0.1}, transform: {translate: {1: [0, 0, 0], 4: [-0.5, 0, 0]}}, material"),
    ] {
        assert_eq!(follows(desk, &changed(old, new)), [Surfaces, Density, Medium, Volumes], "{new}");
    }
}

#[test]
fn a_volume_in_a_shape_that_moves_is_followed() {
    let desk = &mut Desk::new();
    let mist = &SCENE[SCENE.find("  mist:").unwrap()..SCENE.find("lights:").unwrap()];
    let cell = "  cell: {inside: ball, medium: {extinction: 4, albedo: [0.5, 0.9, 0.9]}}\n";
    let ball = "radius: 0.2}, transform: {translate: {1: [0, 0, 0], 4: [0.5, 0.2, 0]}}, visible: false}\n  lamp";
    let (start, end) = (SCENE.find("radius: 0.2}, material").unwrap(), SCENE.find("\n  lamp").unwrap());
    let text = SCENE.replace(mist, cell).replace(&SCENE[start..end + "\n  lamp".len()], ball);
    let text = text.replace("obstacles: [ball]", "obstacles: []");
    let made = follows(desk, &text);
    assert!(made.contains(&Part::Surfaces) && made.contains(&Part::Volumes), "{made:?}");
}

/// A tetrahedron in a node that is carried along, with its numbers in a file beside it.
fn write_gltf(desk: &Desk, way: f32) {
    let floats = |numbers: &[f32]| numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let mut numbers = floats(&[0., 0., 0., 0.5, 0., 0., 0., 0.5, 0., 0., 0., 0.5]);
    numbers.extend([0u16, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    numbers.extend(floats(&[0.0, 0.125, 0.0, 0.0, 0.0, way, 0.0, 0.0]));
    desk.write("stone.bin", &numbers);
    let text = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [0.5, 0.5, 0.5]},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [0.125]},
            {"bufferView": 3, "componentType": 5126, "count": 2, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 24},
            {"buffer": 0, "byteOffset": 72, "byteLength": 8}, {"buffer": 0, "byteOffset": 80, "byteLength": 24}],
        "buffers": [{"byteLength": 104, "uri": "stone.bin"}],
        "animations": [{"channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
            "samplers": [{"input": 2, "output": 3}]}]}"#;
    desk.write("stone.gltf", text);
}

#[test]
fn a_mesh_that_its_file_moves_is_followed() {
    use Part::*;
    let desk = &mut Desk::new();
    write_gltf(desk, 0.5);
    let text = changed("stone.obj", "stone.gltf");
    assert_eq!(follows(desk, &text), [Surfaces, Density, Medium, Volumes]);
    desk.check(&text, 3, None);
    // The file beside it alone.
    write_gltf(desk, 1.0);
    let made = desk.check(&text, 3, None);
    assert!(made.starts_with(&[Shapes, Surfaces]), "{made:?}");
}

/// Smoke with velocities, written by OpenVDB.
#[test]
fn smoke_that_its_file_moves_is_followed() {
    use Part::*;
    let desk = &mut Desk::new();
    let packed = fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/vdb/float_shared.vdb.gz")).unwrap();
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(packed.as_slice()).read_to_end(&mut bytes).unwrap();
    (1..=4).for_each(|frame| desk.write(&format!("smoke.{frame}.vdb"), &bytes));
    let smoke = &SCENE[SCENE.find("smoke:").unwrap()..SCENE.find("volumes:").unwrap()];
    let file = "smoke: {file: {path: smoke.#.vdb, velocity: v}, medium: {extinction: 0.5, albedo: [1, 1, 1]}}\n";
    let text =
        SCENE.replace(smoke, file).replace("[0, 0.6, 3], look_at: [0, 0.5, 0]", "[6, 33, 9], look_at: [6, 33, 3]");
    assert!(follows(desk, &text).contains(&Density));
    desk.check(&text, 2, None);
    let still = text.replace(", velocity: v", "");
    assert_eq!(desk.check(&still, 2, None), [Particles, Density, Medium]);
    assert_eq!(desk.check(&text, 2, None), [Particles, Density, Medium]);
    desk.write("smoke.2.vdb", &bytes);
    assert_eq!(desk.check(&text, 2, None), [Density, Medium]);
}

#[test]
fn pictures_of_the_surroundings_are_followed() {
    use Part::*;
    let desk = &mut Desk::new();
    let write = |desk: &Desk, value: f32| {
        let mut image = Image::new([8, 4]);
        let pixels: [[f32; 3]; 32] = std::array::from_fn(|i| [value * i as f32, value, 0.5]);
        image.push_rgb("", SampleKind::Float, &pixels);
        desk.write("sky.exr", exr::write(&image, Compression::Zips).unwrap());
    };
    write(desk, 0.1);
    let text = changed("radiance: [0.3, 0.4, 0.5]", "file: sky.exr");
    assert_eq!(follows(desk, &text), [Density, Medium, Volumes]);
    desk.check(&text, 2, None);
    write(desk, 0.2);
    assert_eq!(desk.check(&text, 2, None), [Lights]);
    let turning = changed("radiance: [0.3, 0.4, 0.5]", "file: sky.exr, rotate_deg: {1: 0, 4: 180}");
    assert_eq!(follows(desk, &turning), [Lights, Density, Medium, Volumes]);
}

/// Remembers what it was told.
#[derive(Default)]
struct Notes(Mutex<Vec<String>>);

impl Progress for Notes {
    fn note(&self, text: &str) {
        self.0.lock().unwrap().push(text.into());
    }
}

#[test]
fn where_the_camera_stands_is_told_once() {
    let mut desk = Desk::new();
    let notes = Notes::default();
    let warned = || notes.0.lock().unwrap().iter().filter(|note| note.contains("the camera stands inside")).count();
    let inside = changed("position: [0, 0.6, 3]", "position: [0.1, 0.7, 0.01]");
    for (text, count) in
        [(inside.as_str(), 1), (&inside.replace("extinction: 20", "extinction: 30"), 1), (SCENE, 1), (&inside, 2)]
    {
        let scene = desk.scene(text);
        desk.studio.prepare(&scene, 2, &notes).unwrap();
        assert_eq!(warned(), count);
    }
}

/// Cancels when asked for the n-th time.
struct After(AtomicBool, std::sync::atomic::AtomicU32);

impl Progress for After {
    fn is_cancelled(&self) -> bool {
        let left =
            self.1.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| Some(n.saturating_sub(1))).unwrap_or(0);
        self.0.fetch_or(left == 0, Ordering::Relaxed) || left == 0
    }
}

#[test]
fn interrupted_and_failed_work_leaves_nothing_stale() {
    let mut desk = Desk::new();
    desk.check(SCENE, 2, None);
    for n in [0, 1, 2, 5, 20, 40, 100] {
        let scene = desk.scene(&changed("speed: 0.3", &format!("speed: 0.{n}1")));
        let stop = After(AtomicBool::new(false), n.into());
        let prepared = desk.studio.prepare(&scene, 3, &stop);
        if let Err(e) = prepared.and_then(|_| desk.studio.expose(&scene, 3, None, &stop, &mut |_, _| ())) {
            assert!(e.is_cancelled(), "{e}");
        }
        desk.check(&changed("irradiance: [3, 3, 2]", &format!("irradiance: [{n}, 1, 1]")), 2, None);
    }
    // An error in the middle: smoke that is too dense for detail, and a mesh that is none.
    let dense = "extinction: 1e9, albedo: [1, 1, 1]}\n  detail: {length_scale: 0.1}";
    let scene = desk.scene(&changed("extinction: 20, albedo: [0.9, 0.9, 0.8]}", dense));
    assert!(desk.studio.prepare(&scene, 2, &Silent).is_err());
    assert!(desk.studio.expose(&scene, 2, None, &Silent, &mut |_, _| ()).is_err(), "there is nothing to take");
    desk.check(SCENE, 2, None);
    desk.write("stone.obj", "v 0 0 nan\n");
    let scene = desk.scene(SCENE);
    assert!(desk.studio.prepare(&scene, 2, &Silent).is_err());
    desk.write("stone.obj", TETRAHEDRON);
    desk.check(SCENE, 2, None);
}

#[test]
fn pictures_come_in_squares_and_then_in_passes() {
    let desk = &mut Desk::new();
    let scene = desk.scene(&SCENE.replace("[24, 16]", "[90, 70]").replace("spp: 3", "spp: 6"));
    desk.studio.prepare(&scene, 1, &Silent).unwrap();
    let mut seen = Vec::new();
    desk.studio
        .expose(&scene, 1, None, &Silent, &mut |film, done| {
            assert!(film.pixels.iter().all(|p| p.mean.is_finite()));
            assert!(film.paths.traced > 0);
            seen.push(done);
        })
        .unwrap();
    assert_eq!(seen, [0, 0, 0, 1, 2, 4, 6]);
}
