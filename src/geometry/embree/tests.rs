use super::*;
use crate::geometry::mesh::tests::{ball, torus};
use crate::geometry::primitive::{HalfSpace, Primitive, Sphere, Torus};
use crate::geometry::sdf::{PlacedSdf, Sdf};
use crate::math::hash::{CounterRng, Seed};
use crate::math::space::{Similarity, UnitVec3};
use glam::DVec3;

fn solid(primitive: Primitive, extent: f64) -> Arc<Solid> {
    let placed = PlacedSdf::new(Sdf::Primitive(primitive), Similarity::IDENTITY);
    Arc::new(Solid::try_new(&placed, extent).expect("a formula"))
}

fn torus_solid() -> Arc<Solid> {
    solid(Primitive::Torus(Torus { center: DVec3::ZERO, axis: DVec3::Y, major_radius: 0.6, minor_radius: 0.25 }), 1.0)
}

fn committed(build: impl FnOnce(&mut SceneBuilder) -> Result<(), EmbreeError>) -> TraceScene {
    let mut builder = SceneBuilder::new();
    build(&mut builder).expect("run ./bootstrap.sh first");
    builder.commit().expect("committed")
}

fn ray(origin: Vec3, direction: Vec3) -> Ray {
    Ray { origin: WorldPoint(origin), direction: UnitVec3::try_new(direction).expect("a direction") }
}

fn random_rays(count: usize) -> impl Iterator<Item = Ray> {
    let mut rng = CounterRng::new(Seed(8));
    (0..count).map(move |_| {
        let mut cube = || Vec3::from_array(std::array::from_fn(|_| rng.uniform() * 2.0 - 1.0));
        ray(cube() * 2.0, cube())
    })
}

/// The library of 4.3 and later writes further than the structs of older headers reach; ours must hold all of it.
#[test]
fn the_library_writes_no_byte_behind_our_structs() {
    #[repr(C)]
    struct Guarded {
        ray_hit: sys::RtcRayHit,
        behind: [u32; 16],
    }
    #[repr(C)]
    struct GuardedRay {
        ray: sys::RtcRay,
        behind: [u32; 16],
    }
    const GUARD: [u32; 16] = [0xA5A5_5A5A; 16];
    let trace = committed(|b| {
        b.add_mesh(Arc::new(ball(0.3, 16)), 0)?;
        b.add_solid(torus_solid(), 1)
    });
    let scene = trace.scene.as_ref().expect("not empty");
    let mut hits = 0;
    for ray in random_rays(2000) {
        let mut guarded = Guarded { ray_hit: ray_hit(&ray, 0.0, 100.0), behind: GUARD };
        // SAFETY: as in `intersect`.
        unsafe { (scene.functions.intersect1)(scene.handle, from_mut(&mut guarded).cast(), null()) };
        hits += u32::from(guarded.ray_hit.hit.geom_id != INVALID_ID);
        assert_eq!(guarded.behind, GUARD);
        let mut guarded = GuardedRay { ray: guarded.ray_hit.ray, behind: GUARD };
        // SAFETY: as in `is_occluded`.
        unsafe { (scene.functions.occluded1)(scene.handle, from_mut(&mut guarded).cast(), null()) };
        assert_eq!(guarded.behind, GUARD);
    }
    assert!(hits > 100, "{hits}");
}

#[test]
fn nothing_to_hit_needs_no_library_and_gives_no_hit() {
    let trace = SceneBuilder::new().commit().expect("nothing to fail");
    let ray = ray(Vec3::ZERO, Vec3::X);
    assert!(trace.intersect(&ray, 0.0, f32::INFINITY).is_none() && !trace.is_occluded(&ray, 0.0, f32::INFINITY));
    assert!(trace.bounds().is_empty());
}

#[test]
fn a_ball_of_triangles_is_hit_where_the_ball_is() {
    let trace = committed(|b| b.add_mesh(Arc::new(ball(1.0, 64)), 7));
    let hit = trace.intersect(&ray(Vec3::new(0.1, 0.2, 5.0), -Vec3::Z), 0.0, f32::INFINITY).expect("hits");
    assert!((hit.t - (5.0 - (1.0f32 - 0.05).sqrt())).abs() < 2e-3, "{}", hit.t);
    assert_eq!(hit.shape_idx, 7);
    // Outward, and smooth: closer to the ball's own normal than the triangle's.
    let expected = hit.position.0.normalize();
    assert!(hit.normal.dot(expected) > 0.998 && hit.shading_normal.dot(expected) > 0.99999);
    assert!((trace.bounds().size() - Vec3::splat(2.0)).length() < 1e-5);
}

#[test]
fn normals_point_outwards_from_inside_too() {
    let trace = committed(|b| {
        b.add_mesh(Arc::new(ball(1.0, 32)), 0)?;
        b.add_solid(solid(Primitive::Sphere(Sphere { center: DVec3::ZERO, radius: 2.0 }), 1.0), 1)
    });
    for direction in [Vec3::X, Vec3::new(0.3, -0.5, 0.7)] {
        let first = trace.intersect(&ray(Vec3::ZERO, direction), 0.0, 10.0).expect("leaves the ball");
        let again =
            Ray { origin: first.offset_origin(ray(Vec3::ZERO, direction).direction), ..ray(Vec3::ZERO, direction) };
        let second = trace.intersect(&again, 0.0, 10.0).expect("leaves the solid");
        assert_eq!((first.shape_idx, second.shape_idx), (0, 1));
        assert!(first.normal.dot(direction) > 0.5 && first.shading_normal.dot(direction) > 0.5);
        assert!(second.normal.dot(direction) > 0.5 && (second.position.0.length() - 2.0).abs() < 1e-6);
    }
}

#[test]
fn a_solid_torus_is_hit_where_its_triangles_are() {
    let exact = committed(|b| b.add_solid(torus_solid(), 0));
    let meshed = committed(|b| b.add_mesh(Arc::new(torus(0.6, 0.25, 200)), 0));
    let (mut hits, mut differences) = (0, 0);
    for ray in random_rays(20_000) {
        let (a, b) = (exact.intersect(&ray, 0.0, 100.0), meshed.intersect(&ray, 0.0, 100.0));
        assert_eq!(a.is_some(), exact.is_occluded(&ray, 0.0, 100.0));
        assert_eq!(b.is_some(), meshed.is_occluded(&ray, 0.0, 100.0));
        match (a, b) {
            (Some(a), Some(b)) if (a.t - b.t).abs() < 0.02 => hits += 1,
            (None, None) => {}
            _ => differences += 1,
        }
    }
    assert!(hits > 1000 && differences < hits / 50, "{hits} {differences}");
}

#[test]
fn rays_that_leave_a_surface_do_not_meet_it_again() {
    let plane = |y| Primitive::HalfSpace(HalfSpace { point: DVec3::Y * y, normal: DVec3::Y });
    let quad = |half: f32| {
        let corner = |x: f32, z: f32| Vec3::new(x, 1.7, z) * half;
        let corners = vec![corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)];
        Arc::new(Mesh::try_new(corners, Vec::new(), vec![[0, 1, 2], [0, 2, 3]]).expect("valid"))
    };
    let scenes = [
        committed(|b| b.add_solid(solid(plane(0.37), 1000.0), 0)),
        committed(|b| b.add_mesh(quad(0.1), 0)),
        committed(|b| b.add_mesh(quad(100.0), 0)),
        committed(|b| b.add_mesh(Arc::new(ball(0.7, 64)), 0)),
        committed(|b| b.add_solid(solid(Primitive::Sphere(Sphere { center: DVec3::X, radius: 0.7 }), 1.0), 0)),
    ];
    let mut rng = CounterRng::new(Seed(21));
    let mut cube = || Vec3::from_array(std::array::from_fn(|_| rng.uniform() * 2.0 - 1.0));
    for (i, trace) in scenes.iter().enumerate() {
        let mut hits = 0;
        while hits < 20_000 {
            let middle = trace.bounds().center();
            let reach = trace.bounds().size().max_element().min(200.0);
            let origin = middle + Vec3::Y * 0.3 * reach + cube() * reach;
            let target = middle + cube() * 0.5 * reach.min(4.0);
            let Some(direction) = UnitVec3::try_new(target - origin) else { continue };
            let Some(hit) = trace.intersect(&Ray { origin: WorldPoint(origin), direction }, 0.0, f32::INFINITY) else {
                continue;
            };
            hits += 1;
            // Every other one at a grazing angle.
            let n = hit.normal.as_vec3();
            let spread = cube();
            let away = if hits % 2 == 0 { spread.reject_from(n) * 20.0 + n * 0.01 } else { spread };
            let Some(away) = UnitVec3::try_new(if away.dot(n) < 0.0 { -away } else { away }) else { continue };
            let leaving = Ray { origin: hit.offset_origin(away), direction: away };
            assert!(!trace.is_occluded(&leaving, 0.0, f32::INFINITY), "scene {i}: {hit:?} {away:?}");
        }
    }
}

#[test]
fn the_square_of_a_plane_ends_at_its_extent() {
    let trace = committed(|b| {
        b.add_solid(solid(Primitive::HalfSpace(HalfSpace { point: DVec3::Y, normal: DVec3::Y }), 2.0), 0)
    });
    let down = |x: f32, z: f32| trace.intersect(&ray(Vec3::new(x, 3.0, z), -Vec3::Y), 0.0, 10.0);
    assert!((down(1.9, -1.9).expect("inside").t - 2.0).abs() < 1e-6);
    assert!(down(2.1, 0.0).is_none() && down(0.0, 2.1).is_none());
}

#[test]
fn the_closest_triangle_of_a_ball_is_as_far_as_the_ball() {
    let trace = committed(|b| b.add_mesh(Arc::new(ball(0.5, 64)), 0));
    for i in 1..200 {
        let a = i as f32;
        let p = Vec3::new((a * 0.71).sin(), (a * 1.37).cos(), (a * 2.11).sin());
        let d = trace.closest_triangle(WorldPoint(p), 10.0).expect("within ten metres");
        assert!((d - (p.length() - 0.5).abs()).abs() < 1e-3);
        assert_eq!(trace.closest_triangle(WorldPoint(p), d * 0.5), None);
    }
}

#[test]
fn the_version_is_4() {
    assert!(version().expect("run ./bootstrap.sh first").starts_with("4."));
}
