//! Shapes from a scene file: read, placed, hit by rays, and refused with the place in the scene.

use curlsmoke::geometry::Geometry;
use curlsmoke::geometry::embree::Ray;
use curlsmoke::math::space::{UnitVec3, WorldPoint};
use curlsmoke::progress::Silent;
use curlsmoke::scene::Scene;
use glam::Vec3;
use std::path::Path;

const REST: &str = "
version: 1
camera: {position: [0, 0, 5], look_at: [0, 0, 0]}
lights:
  - environment: {radiance: [1, 1, 1]}
";

fn scene(folder: &Path, shapes: &str) -> Scene {
    Scene::from_text(&format!("{REST}{shapes}"), &folder.join("test.yaml")).expect("a valid scene")
}

fn first_hit(geometry: &Geometry, origin: Vec3, direction: Vec3) -> Option<(u32, f32)> {
    let trace = geometry.trace_scene().expect("run ./bootstrap.sh first");
    let ray = Ray { origin: WorldPoint(origin), direction: UnitVec3::try_new(direction).expect("a direction") };
    trace.intersect(&ray, 0.0, f32::INFINITY).map(|hit| (hit.shape_idx, hit.t))
}

#[test]
fn shapes_stand_where_the_scene_says_in_the_order_of_their_names() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = scene(
        folder.path(),
        "
shapes:
  torus: {torus: {center: [0, 0, 0], axis: [0, 0, 1], major_radius: 1, minor_radius: 0.2}, transform: {scale: 2}}
  ball: {sphere: {center: [0, 0, -3], radius: 0.5}}
  floor: {plane: {point: [0, -4, 0]}}
  ghost: {sphere: {center: [0, 0, 3], radius: 1}, visible: false}
",
    );
    let geometry = Geometry::build(&scene, &Silent).expect("built");
    let names: Vec<&str> = geometry.shapes.iter().map(|shape| shape.name.as_str()).collect();
    assert_eq!(names, ["ball", "floor", "ghost", "torus"]);

    // Through the hole of the torus, past the ghost, to the ball.
    let (shape, t) = first_hit(&geometry, Vec3::Z * 5.0, -Vec3::Z).expect("hits the ball");
    assert!(shape == 0 && (t - 7.5).abs() < 1e-5, "{shape} {t}");
    let (shape, t) = first_hit(&geometry, Vec3::new(2.0, 0.0, 5.0), -Vec3::Z).expect("hits the torus");
    assert!(shape == 3 && (t - 4.6).abs() < 1e-5, "{shape} {t}");
    let (shape, t) = first_hit(&geometry, Vec3::new(5.0, 0.0, 5.0), -Vec3::Y).expect("hits the floor");
    assert!(shape == 1 && (t - 4.0).abs() < 1e-5, "{shape} {t}");

    let sdf = geometry.shapes[3].sdf.as_ref().expect("primitives have one");
    assert!((sdf.distance([0.0, 0.0, 0.0]) - 1.6f64).abs() < 1e-6);
}

#[test]
fn the_stone_of_the_gallery_is_closed_and_its_distance_is_that_of_its_triangles() {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let scene = scene(
        &scenes,
        "
shapes:
  stone: {mesh: {file: meshes/stone.obj, distance_voxel: 0.02}, transform: {translate: [0, 1, 0], scale: 1.5}}
flow: {obstacles: [stone]}
",
    );
    let geometry = Geometry::build(&scene, &Silent).expect("built");
    assert!(geometry.warnings.is_empty(), "{:?}", geometry.warnings);
    let stone = &geometry.shapes[0];
    let (sdf, mesh) = (stone.sdf.as_ref().expect("an obstacle"), stone.mesh.as_ref().expect("a mesh"));
    assert!(mesh.report().is_clean() && !mesh.normals().is_empty(), "{}", mesh.report());
    assert_eq!(sdf.center().0.round(), Vec3::Y);

    let trace = geometry.trace_scene().expect("run ./bootstrap.sh first");
    for i in 0..500 {
        let a = i as f32;
        let p = Vec3::new((a * 0.71).sin() * 0.8, 1.0 + (a * 1.37).cos(), (a * 2.11).sin() * 0.8);
        let exact = trace.closest_triangle(WorldPoint(p), 100.0).expect("within a hundred metres");
        let sampled = sdf.distance(p.to_array());
        assert!((sampled.abs() - exact).abs() < 0.012, "{p}: {sampled} {exact}");
    }
}

#[test]
fn a_mesh_that_fails_is_reported_at_its_line_of_the_scene() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("bad.obj"), "v 0 0 0\nv 1 nan 0\n").expect("written");
    let scene = scene(folder.path(), "shapes:\n  thing:\n    mesh:\n      file: bad.obj\n");
    let error = Geometry::build(&scene, &Silent).expect_err("not a mesh").to_string();
    assert!(error.contains("test.yaml:9:13: shapes.thing.mesh.file: "), "{error}");
    assert!(error.contains("bad.obj:2: the coordinate nan is not a finite number"), "{error}");
}

#[test]
fn an_open_obstacle_is_a_warning_and_too_fine_a_distance_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let open = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\n";
    std::fs::write(folder.path().join("open.obj"), open).expect("written");
    let with =
        |mesh: &str| scene(folder.path(), &format!("shapes:\n  a: {{mesh: {mesh}}}\nflow: {{obstacles: [a]}}\n"));
    let geometry = Geometry::build(&with("{file: open.obj, distance_voxel: 0.1}"), &Silent).expect("built");
    assert!(geometry.warnings.len() == 1 && geometry.warnings[0].contains("3 open edges"), "{:?}", geometry.warnings);

    let error = Geometry::build(&with("{file: open.obj, distance_voxel: 1e-4}"), &Silent).expect_err("too fine");
    assert!(error.to_string().contains("shapes.a.mesh.distance_voxel: "), "{error}");
}
