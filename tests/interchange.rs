//! Smoke on its way to other programs and back: what is baked holds what the particles carry, and renders as they do.

#[path = "support/program.rs"]
mod program;

use curlsmoke::grid::DensityGrid;
use curlsmoke::grid::level_set::LevelSet;
use curlsmoke::grid::means::MeanGrid;
use curlsmoke::grid::soft::ObstacleDistance;
use curlsmoke::grid::splat::{SplatInput, SplatSettings, SplatSum, splat};
use curlsmoke::grid::vdb::{
    VdbGrid, VdbWriteSettings, list_grids, parse_float_grid, parse_vector_grid, read_float_grid, read_vector_grid,
    write_grids,
};
use curlsmoke::math::hash::Seed;
use curlsmoke::output::{exr, image::Image};
use glam::{DMat3, DVec3, IVec3};
use program::{Folder, SMOKE, contains, hot_smoke, scene_from_files};
use std::fs;
use std::path::Path;

const LIMIT: u64 = 1 << 28;
const SETTINGS: SplatSettings =
    SplatSettings { voxel_size: 0.05, shutter_seconds: [0.0; 2], soft_radius: None, memory_limit_bytes: LIMIT };

/// Particles with velocities and temperatures that differ from one to the next.
struct Cloud {
    position: [Vec<f32>; 3],
    velocity: [Vec<f32>; 3],
    temperature: Vec<f32>,
    mass: Vec<f32>,
    radius: Vec<f32>,
}

impl Cloud {
    fn new(count: usize) -> Self {
        let draw = |what: u64, low: f32, high: f32| -> Vec<f32> {
            let seed = Seed(5).derive(what);
            (0..count as u64).map(|i| low + (high - low) * seed.uniform(i)).collect()
        };
        Self {
            position: [draw(0, -0.6, 0.4), draw(1, 0.1, 0.9), draw(2, -0.3, 0.5)],
            velocity: [draw(3, -3.0, 1.0), draw(4, 0.0, 5.0), draw(5, -1.0, 1.0)],
            temperature: draw(6, 300.0, 1900.0),
            mass: draw(7, 0.0, 1e-3),
            radius: draw(8, 0.08, 0.2),
        }
    }

    fn carried(&self) -> Vec<&[f32]> {
        self.velocity.iter().chain([&self.temperature]).map(Vec::as_slice).collect()
    }

    fn input<'a>(&'a self, carried: &'a [&'a [f32]], obstacles: Option<&'a dyn ObstacleDistance>) -> SplatInput<'a> {
        SplatInput {
            position: self.position.each_ref().map(Vec::as_slice),
            velocity: self.velocity.each_ref().map(Vec::as_slice),
            bends: None,
            mass: &self.mass,
            radius: &self.radius,
            carried,
            obstacles,
        }
    }

    /// What all particles carry together.
    fn total(&self, carried: &[f32]) -> f64 {
        carried.iter().zip(&self.mass).map(|(&v, &m)| f64::from(v) * f64::from(m)).sum()
    }
}

/// A ball in the midst of the particles, which lie outside of it or inside.
#[derive(Debug)]
struct Ball;

impl ObstacleDistance for Ball {
    fn distances(&self, points: &[DVec3], distances: &mut [f64]) {
        points.iter().zip(distances).for_each(|(p, d)| *d = p.distance(DVec3::new(0.5, 0.5, 0.6)) - 0.3);
    }
}

fn voxels(grid: &DensityGrid) -> Vec<(IVec3, f32)> {
    let of_brick = |(brick, values): (IVec3, [f32; 512])| {
        (0..512).map(move |i| (brick * 8 + curlsmoke::grid::local_voxel(i).as_ivec3(), values[i]))
    };
    grid.occupied_bricks().flat_map(of_brick).filter(|voxel| voxel.1 != 0.0).collect()
}

#[test]
fn density_times_mean_is_what_the_particles_carry() {
    let cloud = Cloud::new(800);
    let carried = cloud.carried();
    for shutter_seconds in [[0.0; 2], [-0.02, 0.05]] {
        let settings = SplatSettings { shutter_seconds, ..SETTINGS };
        let made = splat(&cloud.input(&carried, None), &settings).unwrap();
        let plain = splat(&cloud.input(&[], None), &settings).unwrap();
        assert_eq!(made.grid, plain.grid, "what is carried changes no density");
        for (quantity, found) in made.means.carried_by(&made.grid).into_iter().enumerate() {
            let expected = cloud.total(carried[quantity]);
            let scale = cloud.total(&carried[quantity].iter().map(|v| v.abs()).collect::<Vec<_>>());
            assert!((found - expected).abs() < 2e-6 * scale, "{quantity}: {found} instead of {expected}");
        }
        // A mean is no more extreme than what it is of, and there is none without density.
        for (voxel, _) in voxels(&made.grid) {
            let kelvin = made.means.voxel(3, voxel);
            assert!((299.9..1900.1).contains(&kelvin), "{voxel}: {kelvin} K");
        }
        let beside = IVec3::new(200, 0, 0);
        assert_eq!((made.grid.voxel(beside), made.means.voxel(1, beside)), (0.0, 0.0));
    }
}

#[test]
fn near_walls_what_is_carried_goes_where_the_mass_goes() {
    let cloud = Cloud::new(800);
    let carried = cloud.carried();
    let made = splat(&cloud.input(&carried, Some(&Ball)), &SETTINGS).unwrap();
    assert!(made.mass.faded > 0.01 * made.mass.particles, "no particle is near the wall");
    // The same of a quantity that all have: its mean is that everywhere, whatever the walls take.
    let ones = vec![3.5f32; cloud.mass.len()];
    let constant = splat(&cloud.input(&[&ones], Some(&Ball)), &SETTINGS).unwrap();
    assert_eq!(constant.grid, made.grid);
    for (voxel, _) in voxels(&constant.grid) {
        assert!((constant.means.voxel(0, voxel) - 3.5).abs() < 1e-6, "{voxel}");
    }
    // Of one particle the mean is its own velocity wherever its mass is.
    let one = Cloud::new(1);
    let carried = one.carried();
    let made = splat(&one.input(&carried, Some(&Ball)), &SETTINGS).unwrap();
    assert!(voxels(&made.grid).len() > 20);
    for (voxel, _) in voxels(&made.grid) {
        let v = [0, 1, 2].map(|axis| made.means.voxel(axis, voxel));
        assert!((0..3).all(|axis| (v[axis] - one.velocity[axis][0]).abs() < 1e-5), "{v:?}");
    }
}

#[test]
fn means_do_not_depend_on_batches_and_must_be_of_as_many_quantities() {
    let cloud = Cloud::new(300);
    let carried = cloud.carried();
    let whole = splat(&cloud.input(&carried, None), &SETTINGS).unwrap();
    let mut sum = SplatSum::try_new(SETTINGS).unwrap();
    for range in [0..100, 100..101, 101..300] {
        let part = |values: &'_ Vec<f32>| values[range.clone()].to_vec();
        let part = Cloud {
            position: cloud.position.each_ref().map(part),
            velocity: cloud.velocity.each_ref().map(part),
            temperature: part(&cloud.temperature),
            mass: part(&cloud.mass),
            radius: part(&cloud.radius),
        };
        sum.add(&part.input(&part.carried(), None)).unwrap();
    }
    assert!(sum.add(&cloud.input(&carried[..1], None)).is_err(), "one quantity where there were four");
    assert_eq!(sum.finish().unwrap(), whole);
    let mut bad = Cloud::new(3);
    bad.temperature[1] = f32::NAN;
    let error = splat(&bad.input(&bad.carried(), None), &SETTINGS).unwrap_err().to_string();
    contains(&error, &["particle 1", "carries", "NaN"]);
    let small = SplatSettings { memory_limit_bytes: 1 << 20, ..SETTINGS };
    let error = splat(&cloud.input(&carried, None), &small).unwrap_err().to_string();
    contains(&error, &["MiB", "--memory-limit"]);
}

/// A component of a velocity as it was read.
fn component(parts: &[[DensityGrid; 2]; 3], axis: usize, voxel: IVec3) -> f32 {
    parts[axis][0].voxel(voxel) - parts[axis][1].voxel(voxel)
}

fn splat_with_means() -> (DensityGrid, MeanGrid, MeanGrid) {
    let cloud = Cloud::new(800);
    let made = splat(&cloud.input(&cloud.carried(), None), &SETTINGS).unwrap();
    let mut velocity = made.means;
    let temperature = velocity.split_off(1);
    (made.grid, velocity, temperature)
}

#[test]
fn vectors_and_numbers_come_back_exactly_in_single_and_within_rounding_in_half_precision() {
    let (density, velocity, temperature) = splat_with_means();
    let grids = |factor: f32| {
        [
            ("density", VdbGrid::Density(&density)),
            ("temperature", VdbGrid::Mean { density: &density, mean: &temperature, factor: 1.0 }),
            ("v", VdbGrid::Mean { density: &density, mean: &velocity, factor }),
        ]
    };
    for (is_half, is_zipped) in [(false, false), (false, true), (true, false), (true, true)] {
        let bytes = write_grids(&grids(1.0), VdbWriteSettings { is_half, is_zipped });
        let kelvin = parse_float_grid(&bytes, "temperature", LIMIT).unwrap();
        let v = parse_vector_grid(&bytes, "v", LIMIT).unwrap();
        assert_eq!(voxels(&kelvin).len(), voxels(&density).len());
        for (voxel, _) in voxels(&density) {
            let pairs = [0, 1, 2].map(|axis| (component(&v, axis, voxel), velocity.voxel(axis, voxel)));
            for (found, expected) in pairs.into_iter().chain([(kelvin.voxel(voxel), temperature.voxel(0, voxel))]) {
                // Half precision has steps of 2⁻¹¹, and of 2⁻²⁵ next to 0.
                let bound = if is_half { expected.abs() * 2f32.powi(-11) + 2f32.powi(-25) } else { 0.0 };
                assert!((found - expected).abs() <= bound, "{voxel}: {found} instead of {expected}");
            }
        }
    }
    let bytes = write_grids(&grids(0.25), VdbWriteSettings::default());
    let v = parse_vector_grid(&bytes, "v", LIMIT).unwrap();
    assert!(voxels(&density).iter().all(|&(at, _)| component(&v, 1, at) == 0.25 * velocity.voxel(1, at)));
}

/// Left for `tests/interop/vdb.sh`, where OpenVDB reads it.
#[test]
fn files_of_vectors_for_openvdb_to_read_are_written() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("vdb_means");
    fs::create_dir_all(&folder).unwrap();
    let (density, velocity, temperature) = splat_with_means();
    for (name, is_half) in [("float", false), ("half", true)] {
        let grids = [
            ("density", VdbGrid::Density(&density)),
            ("temperature", VdbGrid::Mean { density: &density, mean: &temperature, factor: 1.0 }),
            ("v", VdbGrid::Mean { density: &density, mean: &velocity, factor: 1.0 }),
        ];
        let bytes = write_grids(&grids, VdbWriteSettings { is_half, is_zipped: true });
        fs::write(folder.join(format!("{name}.vdb")), bytes).unwrap();
    }
    let line = |&(at, d): &(IVec3, f32)| {
        let [vx, vy, vz] = [0, 1, 2].map(|axis| f64::from(velocity.voxel(axis, at)));
        let kelvin = f64::from(temperature.voxel(0, at));
        format!("{} {} {} {} {kelvin} {vx} {vy} {vz}\n", at.x, at.y, at.z, f64::from(d))
    };
    fs::write(folder.join("voxels.txt"), voxels(&density).iter().map(line).collect::<String>()).unwrap();
}

/// Likewise: a ball and a box of which `tests/interop/vdb.sh` knows the distance.
#[test]
fn level_sets_for_openvdb_to_read_are_written() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("vdb_means");
    fs::create_dir_all(&folder).unwrap();
    let distance = |p: [f64; 3]| {
        let p = DVec3::from(p);
        let q = (p - DVec3::new(0.9, 0.1, 0.0)).abs() - DVec3::new(0.25, 0.5, 0.3);
        let cuboid = q.max(DVec3::ZERO).length() + q.max_element().min(0.0);
        (p.distance(DVec3::new(0.1, 0.2, -0.3)) - 0.4).min(cuboid)
    };
    let bounds = [DVec3::new(-0.3, -0.4, -0.7), DVec3::new(1.15, 0.6, 0.3)];
    let level_set = LevelSet::sample(DVec3::new(0.01, 0.0, 0.0), 0.03, bounds, LIMIT, distance).unwrap();
    for (name, is_half) in [("level_set_float", false), ("level_set_half", true)] {
        let settings = VdbWriteSettings { is_half, is_zipped: true };
        let bytes = write_grids(&[("surface", VdbGrid::LevelSet(&level_set))], settings);
        assert_eq!(bytes, write_grids(&[("surface", VdbGrid::LevelSet(&level_set))], settings));
        let error = parse_float_grid(&bytes, "surface", LIMIT).unwrap_err().to_string();
        contains(&error, &["level set"]);
        fs::write(folder.join(format!("{name}.vdb")), bytes).unwrap();
    }
}

fn folder_with(scene: &str) -> Folder {
    let folder = Folder::new();
    folder.write("smoke.yaml", scene);
    folder
}

/// To bake two frames of `smoke.yaml`.
fn baking<'a>(output: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["bake", "smoke.yaml", "--frames", "1-2", "--output", output], more].concat()
}

fn read(folder: &Folder, name: &str, grid: &str) -> DensityGrid {
    read_float_grid(&folder.path(name), grid, LIMIT).unwrap_or_else(|e| panic!("{e}"))
}

/// The rows of a binary PLY of nothing but floats, and the names of its columns.
fn read_ply(path: &Path) -> (Vec<String>, Vec<Vec<f32>>) {
    let bytes = fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    contains(header, &["ply\nformat binary_little_endian 1.0\n"]);
    let names: Vec<_> = header.lines().filter_map(|l| l.strip_prefix("property float ")).map(String::from).collect();
    let count: usize = header.lines().find_map(|l| l.strip_prefix("element vertex ")).unwrap().parse().unwrap();
    let numbers: Vec<f32> = bytes[end..].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    assert_eq!(numbers.len(), count * names.len());
    let rows = numbers.chunks(names.len()).map(<[f32]>::to_vec).collect();
    (names, rows)
}

#[test]
fn what_is_baked_holds_the_mass_the_momentum_and_the_heat_of_the_particles() {
    let folder = folder_with(&hot_smoke());
    let bake = ["bake", "smoke.yaml", "--frames", "2", "--output", "a.####.vdb", "--particles", "p.####.ply"];
    folder.expect(0, &[&bake[..], &["--grids", "velocity,temperature"]].concat());
    let (names, rows) = read_ply(&folder.path("p.0002.ply"));
    assert_eq!(names, ["x", "y", "z", "vx", "vy", "vz", "age", "lifetime", "mass", "radius"]);
    assert!(rows.len() > 1000);
    assert!(rows.iter().all(|row| (0.0..row[7]).contains(&row[6])), "all are alive");
    let sum = |value: &dyn Fn(&[f32]) -> f64| rows.iter().map(|row| value(row)).sum::<f64>();
    let density = read(&folder, "a.0002.vdb", "density");
    assert!((density.mass() / sum(&|row| f64::from(row[8])) - 1.0).abs() < 1e-5);
    let v = read_vector_grid(&folder.path("a.0002.vdb"), "v", LIMIT).unwrap();
    let kelvin = read(&folder, "a.0002.vdb", "temperature");
    let h3 = f64::from(density.voxel_size()).powi(3);
    let all = voxels(&density);
    let carried =
        |value: &dyn Fn(IVec3) -> f32| all.iter().map(|&(at, d)| h3 * f64::from(d) * f64::from(value(at))).sum::<f64>();
    for axis in 0..3 {
        let expected = sum(&|row| f64::from(row[8]) * f64::from(row[3 + axis]));
        let scale = sum(&|row| f64::from(row[8]) * f64::from(row[3 + axis]).abs());
        let found = carried(&|at| component(&v, axis, at));
        assert!((found - expected).abs() < 1e-5 * scale, "axis {axis}: {found} instead of {expected}");
    }
    // Light at 600 nm, by Wien's law.
    let light = |kelvin: f64| (-0.014387768775 / 600e-9 / kelvin).exp() * 1e6;
    let expected = sum(&|row| f64::from(row[8]) * light(300.0 + 1500.0 * (-f64::from(row[6]) / 1.5).exp()));
    let found = carried(&|at| light(f64::from(kelvin.voxel(at))) as f32);
    assert!((found / expected - 1.0).abs() < 1e-3, "{found} instead of {expected}");
    assert!(all.iter().all(|&(at, _)| (300.0..=1800.0).contains(&kelvin.voxel(at))));
    // Metres a frame are a 24th of metres a second.
    let frame = ["--grids", "velocity", "--velocity-units", "frame"];
    folder.expect(0, &[&bake[..6], &["--set", "output.volume=b.####.vdb"], &frame].concat());
    let slow = read_vector_grid(&folder.path("a.0002.vdb"), "v", LIMIT).unwrap();
    for &(at, _) in &all {
        let (fast, slow) = (component(&v, 1, at), component(&slow, 1, at));
        assert!((24.0 * slow - fast).abs() <= 1e-6 * fast.abs(), "{at}: {slow} a frame, {fast} a second");
    }
    let names: Vec<_> = list_grids(&folder.path("a.0002.vdb"), LIMIT).unwrap().into_iter().map(|g| g.name).collect();
    assert_eq!(names, ["density", "v"]);
}

fn picture(folder: &Folder, name: &str) -> Image {
    exr::read(&folder.path(name), LIMIT).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn a_sequence_rendered_from_its_files_is_the_one_rendered_from_particles() {
    let folder = folder_with(SMOKE);
    folder.expect(0, &["bake", "smoke.yaml", "--frames", "1-3", "--output", "a.####.vdb"]);
    folder.write("files.yaml", &scene_from_files(SMOKE, "{path: a.####.vdb}"));
    folder.expect(0, &["render", "smoke.yaml", "--frames", "1-3", "-o", "direct.####.exr"]);
    folder.expect(0, &["render", "files.yaml", "--frames", "1-3", "-o", "files.####.exr"]);
    for frame in 1..=3 {
        let [direct, files] = ["direct", "files"].map(|name| picture(&folder, &format!("{name}.000{frame}.exr")));
        assert_eq!(direct.to_rgb(""), files.to_rgb(""), "frame {frame}");
    }
}

#[test]
fn hot_smoke_from_files_glows_as_its_particles_do() {
    let folder = folder_with(&hot_smoke());
    folder.expect(0, &["bake", "smoke.yaml", "--output", "a.####.vdb", "--grids", "temperature"]);
    folder.write("files.yaml", &scene_from_files(&hot_smoke(), "{path: a.####.vdb}"));
    let dark = ["--set", "lights=[{environment: {radiance: [0, 0, 0]}}]", "--spp", "256", "--frames", "2"];
    let light = |scene: &str, out: &str| {
        folder.expect(0, &[&["render", scene, "-o", out], &dark[..]].concat());
        let image = picture(&folder, &out.replace("####", "0002"));
        let rgb = image.to_rgb("").unwrap();
        [0, 1, 2].map(|c| rgb.iter().map(|pixel| f64::from(pixel[c])).sum::<f64>() / rgb.len() as f64)
    };
    let direct = light("smoke.yaml", "direct.####.exr");
    let files = light("files.yaml", "files.####.exr");
    println!("direct {direct:?}, from files {files:?}");
    for c in 0..3 {
        assert!((files[c].max(1e-9) / direct[c].max(1e-9) - 1.0).abs() < 0.06, "channel {c}: {files:?} and {direct:?}");
    }
}

fn outer(r: DVec3) -> DMat3 {
    DMat3::from_cols(r * r.x, r * r.y, r * r.z)
}

/// Mass, middle and covariance of a density.
fn moments(grid: &DensityGrid) -> (f64, DVec3, DMat3) {
    let h = f64::from(grid.voxel_size());
    let all: Vec<_> =
        voxels(grid).iter().map(|&(at, d)| (grid.origin() + (at.as_dvec3() + 0.5) * h, f64::from(d))).collect();
    let mass: f64 = all.iter().map(|voxel| voxel.1).sum();
    let middle = all.iter().map(|&(p, d)| p * d).sum::<DVec3>() / mass;
    let spread = all.iter().map(|&(p, d)| outer(p - middle) * d).fold(DMat3::ZERO, |a, b| a + b);
    (mass, middle, spread * (1.0 / mass))
}

#[test]
fn imported_velocities_blur_as_far_and_the_same_way_as_the_particles_do() {
    // A gust, a quick turn, and both together with a shutter that is not centred.
    let scene = SMOKE
        .replace("uniform: {velocity: [0.1, 0.4, 0]}", "uniform: {velocity: [4.8, 2.1, -1.2]}")
        .replace("obstacles: [left, right]", "obstacles: []")
        .replace("rate: 2000, mass: 0.2, lifetime: 2", "rate: 100000, mass: 0.2, lifetime: 0.3")
        .replace("voxel_size: 0.04", "voxel_size: 0.025, kernel_radius: 0.06");
    for shutter in ["[-0.5, 0.5]", "[0, 1]", "[-1, -0.2]"] {
        let folder = folder_with(&scene);
        let set = format!("frames.shutter={shutter}");
        let bake = |scene: &str, out: &str, more: &[&str]| {
            folder.expect(0, &[&["bake", scene, "--frames", "3", "--set", &set, "--output", out], more].concat());
            read(&folder, out, "density")
        };
        let direct = bake("smoke.yaml", "direct.vdb", &[]);
        let still = bake("smoke.yaml", "still.vdb", &["--grids", "velocity"]);
        assert_eq!(still, bake("smoke.yaml", "instant.vdb", &["--set", "frames.shutter=[0, 0]"]));
        folder.write("files.yaml", &scene_from_files(&scene, "{path: still.vdb, velocity: v}"));
        let files = bake("files.yaml", "files.vdb", &[]);
        let total: f64 = voxels(&direct).iter().map(|voxel| f64::from(voxel.1)).sum();
        let off = |a: &DensityGrid, b: &DensityGrid| {
            let here = voxels(a).iter().map(|&(at, d)| f64::from(d - b.voxel(at)).abs()).sum::<f64>();
            let there = voxels(b).iter().filter(|voxel| a.voxel(voxel.0) == 0.0).map(|v| f64::from(v.1)).sum::<f64>();
            (here + there) / total
        };
        let [(mass, at, spread), (still_mass, still_at, still_spread), (_, direct_at, direct_spread)] =
            [&files, &still, &direct].map(moments);
        let (moved, expected) = (at - still_at, direct_at - still_at);
        // Second moments of the way gone.
        let wider = spread - still_spread + outer(moved);
        let expected_wider = direct_spread - still_spread + outer(expected);
        let size = |m: DMat3| m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
        let wider_off = size(wider - expected_wider) / size(expected_wider);
        println!(
            "{shutter}: off by {:.3}, unblurred by {:.3}; mass {:.5}; moved {moved:.4} instead of {expected:.4}; wider off by \
             {wider_off:.3} ({:.5} instead of {:.5})",
            off(&files, &direct),
            off(&still, &direct),
            mass / still_mass,
            wider.col(0),
            expected_wider.col(0),
        );
        assert!((mass / still_mass - 1.0).abs() < 0.01);
        assert!(off(&files, &direct) < 0.25 * off(&still, &direct));
        assert!((moved - expected).length() < 0.03 * expected.length().max(0.02), "{moved} instead of {expected}");
        assert!(wider_off < 0.1, "{wider_off}");
    }
}

#[test]
fn obstacles_are_written_as_level_sets_once_or_for_each_frame() {
    let folder = folder_with(SMOKE);
    let bake = |more| baking("a.####.vdb", more);
    folder.expect(0, &bake(&["--obstacles", "walls.vdb"]));
    let info = list_grids(&folder.path("walls.vdb"), LIMIT).unwrap();
    assert_eq!((info.len(), info[0].name.as_str()), (1, "surface"));
    let error = read_float_grid(&folder.path("walls.vdb"), "surface", LIMIT).unwrap_err().to_string();
    contains(&error, &["level set"]);
    // A floor has no end; it is cut where the others and the smoke end.
    let floor =
        SMOKE.replace("  left:", "  floor: {plane: {}}\n  left:").replace("[left, right]", "[left, right, floor]");
    folder.write("smoke.yaml", &floor);
    folder.expect(0, &bake(&["--obstacles", "floor.vdb"]));
    assert!(fs::read(folder.path("floor.vdb")).unwrap().len() > fs::read(folder.path("walls.vdb")).unwrap().len());
    // What moves needs a file for each frame.
    let moving = SMOKE.replace(
        "radius: 0.3}}\n  right",
        "radius: 0.3}, transform: {translate: {1: [0, 0, 0], 3: [0, 0.1, 0]}}}\n  right",
    );
    assert_ne!(moving, SMOKE);
    folder.write("smoke.yaml", &moving);
    let [_, err] = folder.expect(2, &bake(&["--obstacles", "moving.vdb"]));
    contains(&err, &["`left` moves", "####"]);
    folder.expect(0, &bake(&["--obstacles", "moving.####.vdb"]));
    let [first, second] = [1, 2].map(|frame| fs::read(folder.path(&format!("moving.000{frame}.vdb"))).unwrap());
    assert_ne!(first, second);
}

#[test]
fn what_cannot_be_baked_is_refused_with_advice_and_nothing_is_written() {
    let folder = folder_with(SMOKE);
    let bake = |more| baking("out/a.####.vdb", more);
    let cases: [(i32, &[&str], &[&str]); 10] = [
        (2, &["--grids", "velocity", "--velocity-units", "metre"], &["metre", "second", "frame"]),
        (2, &["--grids", "colour"], &["colour", "velocity", "temperature"]),
        (2, &["--velocity-units", "frame"], &["no effect", "--grids velocity"]),
        (3, &["--grids", "temperature"], &["no temperature", "smoke.blackbody"]),
        (3, &["--set", "output.volume_grids=[temperature]"], &["output.volume_grids", "smoke.blackbody"]),
        (2, &["--particles", "out/a.####.vdb"], &["two kinds of files", "a.0001.vdb"]),
        (2, &["--particles", "out/p.ply"], &["frames 1 and 2", "out/p.ply"]),
        (3, &["--particles", "out/p.####.ply", "--set", "smoke.advect.batch=1000"], &["smoke.advect.batch"]),
        (3, &["--obstacles", "out/o.vdb", "--set", "flow.obstacles=[]"], &["flow.obstacles"]),
        (6, &["--grids", "velocity", "--memory-limit", "11MiB", "--set", "smoke.grid.voxel_size=0.01"], &["memory"]),
    ];
    for (code, more, parts) in cases {
        let [_, err] = folder.expect(code, &bake(more));
        contains(&err, parts);
        assert!(folder.files("out").is_empty(), "{more:?}: {:?}", folder.files("out"));
    }
    folder.expect(0, &bake(&[]));
    folder.write("files.yaml", &scene_from_files(&SMOKE.replace("last: 3", "last: 2"), "{path: out/a.####.vdb}"));
    for more in [["--grids", "velocity"], ["--particles", "out/p.####.ply"]] {
        let [_, err] =
            folder.expect(3, &[&["bake", "files.yaml", "--frames", "1", "--output", "b.vdb"], &more[..]].concat());
        contains(&err, &["particles"]);
    }
    fs::write(folder.path("file"), "").unwrap();
    for name in ["--particles", "--obstacles"] {
        let [_, err] = folder.expect(5, &baking("out/a.####.vdb", &[name, "file/x.####"]));
        contains(&err, &["file"]);
    }
    // Baking a scene's own grids without a flag.
    folder.expect(0, &bake(&["--set", "output.volume_grids=[velocity]"]));
    assert_eq!(list_grids(&folder.path("out/a.0001.vdb"), LIMIT).unwrap().len(), 2);
    folder.expect(0, &bake(&["--set", "output.volume_grids=[velocity]", "--half"]));
    assert!(list_grids(&folder.path("out/a.0001.vdb"), LIMIT).unwrap()[1].type_name.ends_with("_HalfFloat"));
}
