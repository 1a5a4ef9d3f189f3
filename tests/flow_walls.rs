//! What walls do to the flow around them: nothing far away, no jets, no jumps, and the same for every way to say it.

use curlsmoke::flow::elements::Shear;
use curlsmoke::flow::field::{FieldSpan, VelocityField};
use curlsmoke::flow::mask::Mask;
use curlsmoke::flow::obstacles::{Boundary, Wall, build_obstacles};
use curlsmoke::flow::octaves::{OctavesSettings, octaves};
use curlsmoke::flow::source::{Potential, Source};
use curlsmoke::geometry::motion::{Motion, Pose};
use curlsmoke::geometry::primitive::{Capsule, Cuboid, HalfSpace, Primitive, Sphere, Torus};
use curlsmoke::geometry::sdf::{PlacedSdf, Sdf};
use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::real::length;
use curlsmoke::math::space::Similarity;
use glam::{DQuat, DVec3};
use std::sync::Arc;

fn solid(primitive: Primitive) -> Wall {
    Arc::new(PlacedSdf::new(Sdf::Primitive(primitive), Similarity::IDENTITY)).into()
}

fn ball(center: DVec3, radius: f64) -> Wall {
    solid(Primitive::Sphere(Sphere { center, radius }))
}

fn ground(height: f64) -> Wall {
    solid(Primitive::HalfSpace(HalfSpace { point: DVec3::Y * height, normal: DVec3::Y }))
}

fn bar(half_length: f64, radius: f64) -> Wall {
    solid(Primitive::Capsule(Capsule { start: DVec3::Y * -half_length, end: DVec3::Y * half_length, radius }))
}

fn cuboid(half_size: DVec3, rounding: f64) -> Wall {
    solid(Primitive::Cuboid(Cuboid { center: DVec3::ZERO, half_size, rounding }))
}

fn ring() -> Wall {
    solid(Primitive::Torus(Torus { center: DVec3::ZERO, axis: DVec3::Y, major_radius: 0.5, minor_radius: 0.15 }))
}

/// From rest, at constant velocity [m/s] and angular velocity [rad/s].
fn moving(wall: Wall, velocity: DVec3, angular_velocity: DVec3) -> Wall {
    let pose = Pose { displacement: velocity, rotation: DQuat::from_scaled_axis(angular_velocity) };
    Wall { motion: Some(Arc::new(Motion::new(vec![(0.0, Pose::REST), (1.0, pose)], false))), ..wall }
}

fn field(sources: Vec<Source>, walls: Vec<Wall>) -> VelocityField {
    VelocityField::new(sources, build_obstacles(walls))
}

fn swirls(length_scale: f64) -> Vec<Source> {
    let settings = OctavesSettings { length_scale, speed: 0.5, octaves: 2, seed: Seed(3), ..Default::default() };
    octaves(&settings).into_iter().map(|o| Potential::Octave(o).into()).collect()
}

/// The largest speed at `count` points within `reach` [m] of the walls, in a box of half size `extent` [m].
fn fastest(span: &FieldSpan, extent: DVec3, reach: f64, count: usize) -> f64 {
    let mut rng = CounterRng::new(Seed(2));
    let mut worst = 0.0f64;
    let mut found = 0;
    while found < count {
        let p = (DVec3::from_array([0, 1, 2].map(|_| f64::from(rng.uniform()))) * 2.0 - 1.0) * extent;
        let distance = span.distance(p.to_array(), 0.0);
        if distance > 0.0 && distance < reach {
            worst = worst.max(length(span.velocity(p.to_array(), 0.0)));
            found += 1;
        }
    }
    worst
}

#[test]
fn what_stands_on_the_ground_disturbs_the_wind_around_it_alone() {
    let alone = field(vec![Source::wind([1.0, 0.0, 0.0])], vec![ball(DVec3::Y * 0.35, 0.35), ground(0.0)]);
    assert_eq!(alone.obstacles().len(), 1, "they touch");
    for height in [0.0, 0.05, 0.2, 1.0] {
        for distance in [5.0, -100.0] {
            let v = alone.velocity([distance, height, 0.3 * distance], 0.0);
            assert!(length([v[0] - 1.0, v[1], v[2]]) < 0.02, "{distance} m away, {height} m up: {v:?}");
        }
    }
    // High above, where the ground is out of reach of every ramp.
    let tall = field(vec![Source::wind([1.0, 0.0, 0.0])], vec![bar(8.0, 0.3), ground(-8.2)]);
    let span = tall.span(0.0, 0.0);
    assert!(fastest(&span, DVec3::new(1.0, 9.0, 1.0), 0.5, 3000) < 4.0);
}

#[test]
fn winds_do_not_jet_along_slender_bodies() {
    let plate = DVec3::new(0.5, 0.5, 0.01);
    let bodies = [
        ("bar", bar(3.0, 0.05), DVec3::new(0.2, 3.2, 0.2)),
        ("post", bar(2.0, 0.15), DVec3::new(0.4, 2.4, 0.4)),
        ("plate", cuboid(plate, 0.0), DVec3::new(0.8, 0.8, 0.3)),
        ("box", cuboid(DVec3::new(0.3, 0.4, 0.2), 0.0), DVec3::new(0.6, 0.7, 0.5)),
        ("ball", ball(DVec3::ZERO, 0.4), DVec3::splat(0.7)),
        ("ring", ring(), DVec3::new(0.9, 0.4, 0.9)),
    ];
    for (name, wall, extent) in bodies {
        let across = if name == "plate" { DVec3::X } else { DVec3::Y };
        let winds = [DVec3::X, DVec3::Y, DVec3::new(0.6, 0.0, 0.8), across];
        for wind in winds {
            let still = field(vec![Source::wind(wind.to_array())], vec![wall.clone()]);
            let found = fastest(&still.span(0.0, 0.0), extent, 0.3, 4000);
            println!("{name} in the wind {wind}: {found:.2} of its speed at most");
            assert!(found < 4.0, "{name}, {wind}: {found}");
            let carried = field(vec![], vec![moving(wall.clone(), wind, DVec3::ZERO)]);
            let found = fastest(&carried.span(0.0, 0.0), extent, 0.3, 4000);
            assert!(found < 4.0, "{name} moving at {wind}: {found}");
        }
    }
}

#[test]
fn what_is_not_a_wind_does_not_jet_along_slender_bodies_either() {
    let extent = DVec3::new(0.4, 3.3, 0.4);
    let everywhere = Mask::Height { axis: DVec3::Y, from: -90.0, to: -80.0 };
    let masked = Source { masks: vec![everywhere.into()], ..Source::wind([1.0, 0.0, 0.0]) };
    // Up to 6.6 m/s within the extent.
    let shear: Source = Potential::Shear(Shear::new(DVec3::X, DVec3::Y, 2.0, DVec3::ZERO)).into();
    for (name, source, free) in [("wind with a mask", masked, 1.0), ("shear", shear, 6.6)] {
        let found = fastest(&field(vec![source], vec![bar(3.0, 0.05)]).span(0.0, 0.0), extent, 0.3, 4000);
        println!("{name} round a bar: {:.2} of its speed", found / free);
        assert!(found < 3.0 * free, "{name}: {found}");
    }
    let turning = field(vec![], vec![moving(bar(3.0, 0.05), DVec3::ZERO, DVec3::Z)]);
    let found = fastest(&turning.span(0.0, 0.0), extent, 0.3, 4000);
    println!("a bar that turns: {:.2} of the speed of its ends", found / 3.05);
    assert!(found < 2.0 * 3.05, "{found}");
    let held = |wall: Wall| Wall { boundary: Boundary::NoSlip, ..wall };
    let post = field(vec![Source::wind([1.0, 0.0, 0.0])], vec![held(bar(1.0, 0.3)), held(ground(-1.3))]);
    let found = fastest(&post.span(0.0, 0.0), DVec3::new(1.0, 1.3, 1.0), 0.5, 4000);
    println!("a post on the ground, both held fast: {found:.2} of the wind");
    assert!(found < 8.0, "{found}");
}

#[test]
fn the_velocity_has_no_jumps_anywhere() {
    let corner = vec![ground(-0.4), cuboid(DVec3::new(0.3, 0.4, 0.3), 0.0), ball(DVec3::new(0.5, -0.1, 0.2), 0.3)];
    let room = Wall { is_container: true, ..cuboid(DVec3::new(1.1, 0.9, 1.0), 0.0) };
    let turning = moving(bar(0.5, 0.15), DVec3::new(0.3, 0.0, 0.0), DVec3::new(0.0, 1.0, 2.0));
    let scenes = [
        ("capsule", vec![bar(0.5, 0.2)]),
        ("rounded box", vec![cuboid(DVec3::new(0.3, 0.4, 0.3), 0.2)]),
        ("sharp box", vec![cuboid(DVec3::new(0.3, 0.4, 0.3), 0.0)]),
        ("solids that touch", corner),
        ("solids with gaps", vec![bar(0.5, 0.2), ball(DVec3::X * 0.8, 0.3), ground(-0.9), ball(DVec3::Z, 0.4)]),
        ("closed box", vec![room.clone()]),
        ("closed box with a body", vec![room, turning]),
        ("ring", vec![ring()]),
        ("no slip", vec![Wall { boundary: Boundary::NoSlip, ..bar(0.5, 0.2) }, ground(-0.9)]),
    ];
    for (name, walls) in scenes {
        let mut sources = swirls(0.6);
        sources.push(Source::wind([0.7, 0.5, -0.3]));
        let field = field(sources, walls);
        let span = field.span(0.2, 0.0);
        let mut rng = CounterRng::new(Seed(8));
        let mut random = || DVec3::from_array([0, 1, 2].map(|_| f64::from(rng.uniform()) * 2.4 - 1.2));
        let (mut jump, mut count) = (0.0f64, 0);
        for _ in 0..250 {
            let (from, to) = (random(), random());
            // The largest change over a short way, and then over a hundredth of that way where it was.
            let steps = 600;
            let at = |t: f64| from.lerp(to, t);
            let free = |t: f64| span.distance(at(t).to_array(), 0.0) > 1e-3;
            let v = |t: f64| DVec3::from_array(span.velocity(at(t).to_array(), 0.0));
            let h = 1.0 / f64::from(steps);
            for i in 0..steps {
                let t = f64::from(i) * h;
                if !(free(t) && free(t + h)) {
                    continue;
                }
                count += 1;
                let (mut low, mut width) = (t, h);
                let mut change = (v(t + h) - v(t)).length();
                if change < 0.02 {
                    continue;
                }
                // Where the change is steepest, halved ten times: of a jump all is left, of a slope a thousandth.
                for _ in 0..10 {
                    width *= 0.5;
                    let (left, right) =
                        ((v(low + width) - v(low)).length(), (v(low + 2.0 * width) - v(low + width)).length());
                    if right > left {
                        low += width;
                    }
                    change = left.max(right);
                }
                jump = jump.max(change);
            }
        }
        println!("{name}: no jump above {jump:.1e} m/s in {count} steps");
        assert!(count > 50_000 && jump < 5e-3, "{name}: {jump} in {count}");
    }
}

#[test]
fn along_a_ground_that_lets_it_slide_the_flow_is_as_without_the_ground() {
    let velocity = DVec3::new(1.0, 0.0, 0.5);
    let everywhere = Mask::Height { axis: DVec3::Y, from: -9.0, to: -8.0 };
    let masked = Source { masks: vec![everywhere.into()], ..Source::wind(velocity.to_array()) };
    let sources = [
        ("wind", Source::wind(velocity.to_array())),
        ("wind with a mask of 1", masked),
        ("shear", Potential::Shear(Shear::new(DVec3::X, DVec3::Y, 1.0, DVec3::Y * -2.0)).into()),
    ];
    for (name, source) in sources {
        let free = field(vec![source.clone()], vec![]);
        for level in [-1.0, 0.0, 0.4] {
            let bounded = field(vec![source.clone()], vec![ground(level)]);
            for height in [0.0, 0.1, 0.6, 2.0] {
                let p = [4.0, level + height, -7.0];
                let difference = DVec3::from_array(bounded.velocity(p, 0.0)) - DVec3::from_array(free.velocity(p, 0.0));
                assert!(difference.length() < 1e-7, "{name}, {height} m above {level}: {difference}");
            }
        }
    }
}

#[test]
fn far_from_what_stands_on_the_ground_all_that_slides_does() {
    let everywhere = Mask::Height { axis: DVec3::Y, from: -9.0, to: -8.0 };
    let masked = Source { masks: vec![everywhere.into()], ..Source::wind([1.0, 0.0, 0.5]) };
    let shear = Potential::Shear(Shear::new(DVec3::X, DVec3::Y, 1.0, DVec3::Y * -2.0)).into();
    for source in [masked, shear] {
        let free = field(vec![source.clone()], vec![]);
        let bounded = field(vec![source], vec![ground(0.0), ball(DVec3::Y * 0.35, 0.35)]);
        for height in [0.0, 0.1, 0.6, 2.0] {
            let p = [4.0, height, -7.0];
            let difference = DVec3::from_array(bounded.velocity(p, 0.0)) - DVec3::from_array(free.velocity(p, 0.0));
            assert!(difference.length() < 1e-7, "{height}: {difference}");
        }
    }
}

#[test]
fn a_straight_step_ends_on_this_side_of_thin_walls() {
    let plate = |center: DVec3| {
        let half_size = DVec3::new(0.005, 0.5, 0.5);
        solid(Primitive::Cuboid(Cuboid { center, half_size, rounding: 0.0 }))
    };
    let alone = field(vec![], vec![plate(DVec3::ZERO)]);
    let standing = field(vec![], vec![plate(DVec3::Y * 0.5), ground(0.0)]);
    assert_eq!(standing.obstacles().len(), 1);
    let mut rng = CounterRng::new(Seed(12));
    for (name, field) in [("alone", &alone), ("standing on the ground", &standing)] {
        let span = field.span(0.0, 0.1);
        for _ in 0..2000 {
            let (length, share) = (0.01 + 0.5 * rng.uniform(), rng.uniform());
            let height = if name == "alone" { 0.3 * rng.uniform() } else { 0.005 + 0.3 * rng.uniform() };
            let from = [-0.006 - length * share, height, 0.2 * rng.uniform()];
            let to = [from[0] + 0.012 + length, from[1], from[2]];
            let ([x, ..], moved) = span.settled(from, to, 0.0);
            assert!(moved && x < 0.0, "{name}: from {from:?} to {to:?} ended at {x}");
        }
    }
    // The plate overtakes a particle that moves more slowly.
    let swept = field(vec![], vec![moving(plate(DVec3::ZERO), DVec3::X, DVec3::ZERO)]);
    let ([x, ..], moved) = swept.span(0.0, 0.1).settled([0.01, 0.1, 0.0], [0.08, 0.1, 0.0], 0.0);
    assert!(moved && x > 0.105, "{x}");
}

#[test]
fn in_the_middle_of_a_box_the_flow_is_as_without_it() {
    let room = Wall { is_container: true, ..cuboid(DVec3::new(1.0, 0.8, 1.2), 0.0) };
    let (free, bounded) = (field(swirls(0.3), vec![]), field(swirls(0.3), vec![room]));
    let mut rng = CounterRng::new(Seed(5));
    for _ in 0..200 {
        let p = [0, 1, 2].map(|_| f64::from(rng.uniform()) - 0.5);
        assert_eq!(bounded.velocity(p, 0.0), free.velocity(p, 0.0), "{p:?}");
    }
}

/// Mean speed along the axis of a ring through its hole.
fn through_hole(field: &VelocityField, center: DVec3) -> f64 {
    let n = 400;
    let speed = |i: u32| {
        let r = 0.35 * (f64::from(i) + 0.5) / f64::from(n);
        let p = center + DVec3::new(r * 0.8, 0.0, r * 0.6);
        2.0 * r * field.velocity(p.to_array(), 0.0)[1] / 0.35 / f64::from(n)
    };
    (0..n).map(speed).sum()
}

#[test]
fn air_passes_through_the_hole_of_a_ring_that_moves() {
    let wind = field(vec![Source::wind([0.0, 1.0, 0.0])], vec![moving(ring(), DVec3::X * 0.3, DVec3::Z * 0.2)]);
    let passed = through_hole(&wind, DVec3::ZERO);
    println!("through the hole of a ring that moves sideways: {passed:.2} of the wind");
    assert!(passed > 0.8 && passed < 3.0);
}

#[test]
fn a_body_that_moves_through_still_air_is_a_body_in_the_wind_seen_by_another() {
    let v = DVec3::new(0.4, 1.0, -0.3);
    for wall in [ring(), bar(0.6, 0.2), ball(DVec3::X * 0.1, 0.4), cuboid(DVec3::new(0.3, 0.4, 0.2), 0.1)] {
        let moved = field(vec![], vec![moving(wall.clone(), v, DVec3::ZERO)]);
        let blown = field(vec![Source::wind((-v).to_array())], vec![wall]);
        let mut rng = CounterRng::new(Seed(6));
        for _ in 0..500 {
            let p = [0, 1, 2].map(|_| f64::from(rng.uniform()) * 2.0 - 1.0);
            let (a, b) = (moved.velocity(p, 0.0), blown.velocity(p, 0.0));
            let difference = DVec3::from_array(a) - (DVec3::from_array(b) + v);
            assert!(difference.length() < 1e-6, "{p:?}: {difference}");
        }
    }
}
