//! Properties of particles: frames that stand alone, and obstacles that nothing enters.

use curlsmoke::flow::field::VelocityField;
use curlsmoke::flow::obstacles::{Wall, build_obstacles};
use curlsmoke::flow::octaves::{OctavesSettings, kolmogorov_gain, octaves};
use curlsmoke::flow::source::{Potential, Source};
use curlsmoke::geometry::mesh_file::read_mesh;
use curlsmoke::geometry::mesh_sdf::MeshSdf;
use curlsmoke::geometry::motion::{Motion, Pose};
use curlsmoke::geometry::primitive::{Cuboid, Primitive, Sphere, Torus};
use curlsmoke::geometry::sdf::{PlacedSdf, Sdf};
use curlsmoke::math::hash::Seed;
use curlsmoke::math::space::Similarity;
use curlsmoke::particles::advect::{CLASSICAL, EULER, MIDPOINT, Scheme};
use curlsmoke::particles::emit::{Emitter, Place, Schedule};
use curlsmoke::particles::system::{KernelSize, TimeGrid};
use curlsmoke::particles::{ParticleSystem, Particles, ParticlesError};
use curlsmoke::progress::{Progress, Silent};
use glam::DVec3;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

fn field() -> VelocityField {
    let swirls = OctavesSettings {
        length_scale: 0.5,
        speed: 0.8,
        octaves: 3,
        lacunarity: 2.0,
        gain: kolmogorov_gain(2.0),
        spin_rate: 0.5,
        scroll: [0.0, 0.4, 0.0],
        seed: Seed(4),
        ..Default::default()
    };
    let mut sources: Vec<Source> = octaves(&swirls).into_iter().map(|o| Potential::Octave(o).into()).collect();
    sources.push(Source::wind([0.0, 0.8, 0.0]));
    let solids = [
        Primitive::Sphere(Sphere { center: DVec3::new(0.1, 0.8, 0.0), radius: 0.3 }),
        Primitive::Torus(Torus { center: DVec3::Y * 1.9, axis: DVec3::Y, major_radius: 0.4, minor_radius: 0.1 }),
        Primitive::Cuboid(Cuboid {
            center: DVec3::new(0.7, 0.9, 0.1),
            half_size: DVec3::new(0.15, 0.3, 0.2),
            rounding: 0.0,
        }),
    ];
    let solids = solids.map(|p| Arc::new(PlacedSdf::new(Sdf::Primitive(p), Similarity::IDENTITY)));
    VelocityField::new(sources, build_obstacles(solids.to_vec()))
}

fn emitter(place: Place, schedule: Schedule, seed: u64) -> Emitter {
    Emitter {
        place,
        strands: None,
        schedule,
        start: -0.3,
        stop: f64::INFINITY,
        lifetime: 1.5,
        lifetime_spread: 0.3,
        particle_mass: 1.0,
        fade_in: 0.1,
        fade_out: 0.3,
        seed: Seed(seed),
        motion: None,
    }
}

fn system(rate: f64, scheme: Scheme, substeps: u32) -> ParticleSystem {
    let disk = Place::Disk { center: DVec3::Y * 0.05, normal: DVec3::Y, radius: 0.4 };
    let ball = Place::Ball { center: DVec3::new(0.1, 0.6, 0.0), radius: 0.2 };
    let emitters = vec![emitter(disk, Schedule::Rate(rate), 1), emitter(ball, Schedule::Count((rate * 0.3) as u64), 2)];
    let grid = TimeGrid { first_frame: 1, substeps, fps: 24.0 };
    ParticleSystem::new(field(), emitters, grid, scheme, KernelSize { initial_radius: 0.03, expansion: 0.01 })
}

#[test]
fn a_frame_alone_equals_the_same_frame_of_a_sequence_to_the_bit() {
    let mut sequence = system(2000.0, CLASSICAL, 2);
    let mut backwards = system(2000.0, CLASSICAL, 2);
    backwards.at_frame(60, &Silent).unwrap();
    for frame in 1..=40 {
        let in_sequence = sequence.at_frame(frame, &Silent).unwrap().clone();
        if [1, 2, 20, 37, 40].contains(&frame) {
            let alone = system(2000.0, CLASSICAL, 2).at_frame(frame, &Silent).unwrap().clone();
            assert!(alone == in_sequence, "frame {frame}");
            assert!(*backwards.at_frame(frame, &Silent).unwrap() == in_sequence, "frame {frame}, from a later one");
            assert!(in_sequence.len() > 500);
            assert!(in_sequence.id.is_sorted());
        }
    }
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let alone = one_thread.install(|| system(2000.0, CLASSICAL, 2).at_frame(40, &Silent).unwrap().clone());
    assert!(alone == *sequence.at_frame(40, &Silent).unwrap(), "on one thread");
}

#[test]
fn batches_carried_from_birth_are_the_same_particles_to_the_bit() {
    let mut whole = system(2000.0, CLASSICAL, 2);
    let mut batched = system(2000.0, CLASSICAL, 2);
    for (frame, batch) in [(40, 300), (3, 97), (1, 100_000)] {
        let expected = whole.at_frame(frame, &Silent).unwrap().clone();
        let mut found = Particles::default();
        let mut visit = |particles: &Particles| {
            assert!(particles.len() as u64 <= batch && !particles.is_empty());
            let Particles { position, velocity, bends: _, mass, radius, age, id } = particles;
            found.position.iter_mut().zip(position).for_each(|(all, some)| all.extend(some));
            found.velocity.iter_mut().zip(velocity).for_each(|(all, some)| all.extend(some));
            found.mass.extend(mass);
            found.radius.extend(radius);
            found.age.extend(age);
            found.id.extend(id);
            Ok::<_, ParticlesError>(())
        };
        batched.visit_batches(frame, batch, &Silent, &mut visit).unwrap();
        assert!(found == expected && found.len() > 500, "frame {frame}, {batch} at a time");
        assert!(batched.particles().is_empty());
    }
    let stop = |_: &Particles| Err(ParticlesError::Cancelled);
    assert!(matches!(batched.visit_batches(3, 97, &Silent, &mut { stop }), Err(ParticlesError::Cancelled)));
}

#[test]
fn after_96_frames_no_particle_is_inside_an_obstacle() {
    for (name, scheme, substeps) in [("rk4", CLASSICAL, 1), ("euler", EULER, 1)] {
        let mut system = system(4000.0, scheme, substeps);
        let mut seen = 0;
        for frame in 1..=96 {
            let particles = system.at_frame(frame, &Silent).unwrap();
            seen += particles.len();
        }
        let particles = system.at_frame(96, &Silent).unwrap().clone();
        let inside = (0..particles.len())
            .filter(|&i| system.walls().distance([0, 1, 2].map(|a| f64::from(particles.position[a][i])), 0.0) < 0.0)
            .count();
        println!(
            "{name}: {} alive of {seen} particle frames, {inside} inside; {} steps of {} corrected, {} born inside",
            particles.len(),
            system.penetrations(),
            system.particle_steps(),
            system.born_inside()
        );
        assert_eq!(inside, 0);
        assert!(system.born_inside() > 0, "the ball touches the sphere");
        if scheme == EULER {
            assert!(system.penetrations() > 0, "long steps of first order do cut corners");
        } else {
            assert!((system.penetrations() as f64) < 1e-2 * system.particle_steps() as f64);
        }
    }
}

/// A stone that is a mesh, a ball that swings through, and a box.
fn three_walls() -> Vec<Wall> {
    let stone = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes/stone.obj");
    let stone = MeshSdf::sample(&read_mesh(&stone, 1 << 30).unwrap(), None, 1 << 30).unwrap();
    let placed = |sdf: Sdf| Wall::from(Arc::new(PlacedSdf::new(sdf, Similarity::IDENTITY)));
    let ball = placed(Sdf::Primitive(Primitive::Sphere(Sphere { center: DVec3::new(-1.0, 0.9, 0.1), radius: 0.25 })));
    let across = Pose { displacement: DVec3::X * 2.0, ..Pose::REST };
    let swing = Motion::new(vec![(0.0, Pose::REST), (4.0, across), (8.0, Pose::REST)], true);
    let half_size = DVec3::new(0.2, 0.3, 0.25);
    let cuboid = Cuboid { center: DVec3::new(0.7, 0.2, -0.1), half_size, rounding: 0.0 };
    vec![
        placed(Sdf::Mesh(Arc::new(stone))),
        Wall { motion: Some(Arc::new(swing)), ..ball },
        placed(Sdf::Primitive(Primitive::Cuboid(cuboid))),
    ]
}

/// The number of particles alive in the end, of those inside a wall at any frame, and the share of steps corrected.
fn round_three_walls(count: u64, frames: i32) -> (usize, usize, f64) {
    let settings =
        OctavesSettings { length_scale: 0.5, speed: 0.5, spin_rate: 0.3, seed: Seed(6), ..Default::default() };
    let mut sources: Vec<Source> = octaves(&settings).into_iter().map(|o| Potential::Octave(o).into()).collect();
    sources.push(Source::wind([0.0, 0.4, 0.0]));
    let field = VelocityField::new(sources, build_obstacles(three_walls()));
    let below = Place::Cuboid { center: DVec3::Y * -1.1, size: DVec3::new(2.0, 0.8, 1.0) };
    let once = Emitter { lifetime: 20.0, start: 0.0, ..emitter(below, Schedule::Count(count), 3) };
    let time = TimeGrid { first_frame: 1, substeps: 2, fps: 24.0 };
    let kernel = KernelSize { initial_radius: 0.1, expansion: 0.0 };
    let mut system = ParticleSystem::new(field, vec![once], time, MIDPOINT, kernel);
    let mut inside = 0;
    for frame in 1..=frames {
        let particles = system.at_frame(frame, &Silent).unwrap().clone();
        let span = system.walls().span(f64::from(frame - 1) / 24.0, 0.0);
        let is_inside = |i: &usize| span.distance([0, 1, 2].map(|a| f64::from(particles.position[a][*i])), 0.0) < 0.0;
        inside += (0..particles.len()).into_par_iter().filter(is_inside).count();
    }
    assert_eq!(system.born_inside(), 0);
    let corrected = system.penetrations() as f64 / system.particle_steps() as f64;
    (system.particles().len(), inside, corrected)
}

#[test]
fn no_particle_is_inside_a_mesh_a_moving_ball_or_a_box_at_any_frame() {
    let (alive, inside, corrected) = round_three_walls(3000, 192);
    println!("{alive} particles, {inside} inside, {:.4} % of steps corrected", 100.0 * corrected);
    assert!(alive == 3000 && inside == 0 && corrected < 1e-3, "{alive} {inside} {corrected}");
}

#[test]
#[ignore = "takes minutes"]
fn a_million_particles_go_round_three_walls() {
    let (alive, inside, corrected) = round_three_walls(1_000_000, 240);
    println!("{alive} particles, {inside} inside, {:.4} % of steps corrected", 100.0 * corrected);
    assert!(alive == 1_000_000 && inside == 0 && corrected < 1e-4, "{alive} {inside} {corrected}");
}

#[test]
fn mass_velocity_age_and_radius_belong_to_the_frame() {
    let mut system = system(1000.0, CLASSICAL, 1);
    let particles = system.at_frame(10, &Silent).unwrap().clone();
    let time = 9.0 / 24.0;
    for i in (0..particles.len()).step_by(17) {
        let p = [0, 1, 2].map(|a| f64::from(particles.position[a][i]));
        let v = system.walls().velocity(p, time);
        for (exact, single) in v.iter().zip(&particles.velocity) {
            assert!((exact - f64::from(single[i])).abs() < 2e-3);
        }
        let age = particles.age[i];
        assert!((0.0..2.0).contains(&age) && (0.0..=1.0).contains(&particles.mass[i]));
        assert!((particles.radius[i].powi(2) - (0.03f32.powi(2) + 0.01f32.powi(2) * age)).abs() < 1e-7);
    }
}

#[derive(Default)]
struct Counting {
    units: AtomicU64,
    is_cancelled: bool,
}

impl Progress for Counting {
    fn advance(&self, units: u64) {
        self.units.fetch_add(units, Ordering::Relaxed);
    }
    fn is_cancelled(&self) -> bool {
        self.is_cancelled
    }
}

#[test]
fn progress_is_told_and_cancelling_is_obeyed() {
    let mut system = system(1000.0, CLASSICAL, 1);
    let counting = Counting::default();
    system.at_frame(10, &counting).unwrap();
    assert_eq!(counting.units.load(Ordering::Relaxed), system.particle_steps());
    let cancelled = Counting { is_cancelled: true, ..Counting::default() };
    assert!(matches!(system.at_frame(20, &cancelled), Err(ParticlesError::Cancelled)));
    assert!(system.at_frame(20, &Silent).is_ok());
}

/// Stops after some looks.
struct Stopping(AtomicU64);

impl Progress for Stopping {
    fn is_cancelled(&self) -> bool {
        self.0.fetch_sub(1, Ordering::Relaxed) == 0
    }
}

#[test]
fn a_way_is_counted_from_the_frame_before_also_where_it_was_cancelled_or_is_asked_for_again() {
    let mut alone = system(1000.0, CLASSICAL, 1);
    alone.at_frame(10, &Silent).unwrap();
    let first = alone.way();
    alone.at_frame(20, &Silent).unwrap();
    let second = alone.way();
    assert!(
        first.born > second.born && second.born > 0 && first.born_inside > 0 && second.penetrations > 0,
        "{first:?} {second:?}"
    );
    assert_eq!([alone.born(), alone.born_inside()], [first.born + second.born, first.born_inside + second.born_inside]);
    alone.at_frame(20, &Silent).unwrap();
    assert_eq!(alone.way(), second, "asked for again");
    alone.at_frame(10, &Silent).unwrap();
    assert_eq!(alone.way(), first, "with its run-up");
    assert!(alone.at_frame(20, &Stopping(AtomicU64::new(4))).is_err());
    assert!(alone.way().born < second.born);
    alone.at_frame(20, &Silent).unwrap();
    assert_eq!(alone.way(), second, "in two goes");
    alone.visit_batches::<ParticlesError>(10, 100, &Silent, &mut |_| Ok(())).unwrap();
    assert_eq!(alone.way(), first, "in batches");
}
