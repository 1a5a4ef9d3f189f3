//! `.vdb` files: foreign ones written by OpenVDB, our own there and back, and damaged ones.
//!
//! `tests/data/vdb` holds files written by OpenVDB 10 (`tests/interop/make_fixtures.py`), gzipped because the masks of a
//! tree are mostly zeros. `tests/interop/vdb.sh` checks the other direction, OpenVDB reading what we write.

use curlsmoke::grid::vdb::{
    VdbProblem, VdbWriteSettings, parse_float_grid, parse_grid_list, read_float_grid, write_float_grids,
};
use curlsmoke::grid::{DensityGrid, GridError};
use curlsmoke::math::hash::Seed;
use curlsmoke::math::space::WorldPoint;
use glam::{DVec3, IVec3, UVec3};
use std::io::Read;

const LIMIT: u64 = 1 << 28;

fn fixture(name: &str) -> Vec<u8> {
    let path = format!("{}/tests/data/vdb/{name}.vdb.gz", env!("CARGO_MANIFEST_DIR"));
    let packed = std::fs::read(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(packed.as_slice()).read_to_end(&mut bytes).expect("a gzip file");
    bytes
}

fn formula(v: IVec3) -> f32 {
    ((7 * v.x + 13 * v.y + 29 * v.z).rem_euclid(64) + 1) as f32 / 64.0
}

fn is_in(v: IVec3, low: [i32; 3], high: [i32; 3]) -> bool {
    v.cmpge(IVec3::from_array(low)).all() && v.cmple(IVec3::from_array(high)).all()
}

/// What `make_fixtures.py` put at voxel `v` of grid "density".
fn expected(v: IVec3) -> f32 {
    match v.to_array() {
        [3, 121, 1] => 0.5,
        [-4, 121, 1] => 0.25,
        [-4, 121, 3] => 0.75,
        [9, 129, n @ 0..5] => (n + 1) as f32 / 8.0,
        _ if is_in(v, [16, 128, 0], [23, 135, 7]) => 1.5,
        _ if is_in(v, [16, 136, 0], [23, 143, 7]) => 0.75,
        _ if is_in(v, [24, 128, 0], [31, 135, 7]) => formula(IVec3::new(v.x / 2, v.y / 4, 0)),
        _ => {
            let d = v - IVec3::new(-5, 120, -3);
            let is_set = is_in(d, [0, 0, 0], [16, 15, 11]) && d.x % 3 == 0 && d.y % 2 == 0 && d.z % 2 == 0;
            if is_set { formula(v) } else { 0.0 }
        }
    }
}

fn check_density(grid: &DensityGrid) {
    for x in -12..40 {
        for y in 110..150 {
            for z in -12..20 {
                let v = IVec3::new(x, y, z);
                assert_eq!(grid.voxel(v), expected(v), "{v}");
            }
        }
    }
    assert_eq!(grid.voxel_size(), 0.25);
    // OpenVDB's sample (0, 0, 0) is at (0.5, −1, 2), and is the centre of our voxel.
    assert_eq!(grid.origin(), DVec3::new(0.375, -1.125, 1.875));
    // The sample is there and is the formula's: single precision moves the place by less than 1e-6 voxels.
    let v = IVec3::new(1, 122, 1);
    let at = WorldPoint::new(0.5 + 0.25, -1.0 + 0.25 * 122.0, 2.0 + 0.25);
    assert!((grid.density(at) - expected(v)).abs() < 1e-5 && expected(v) > 0.0);
}

#[test]
fn files_written_by_openvdb_read_exactly_in_every_precision_and_compression() {
    for precision in ["float", "half"] {
        for codec in ["none", "active", "zip", "blosc"] {
            let name = format!("{precision}_{codec}");
            let grid = parse_float_grid(&fixture(&name), "density", LIMIT).unwrap_or_else(|e| panic!("{name}: {e}"));
            check_density(&grid);
        }
    }
}

#[test]
fn grids_are_found_by_name_and_instances_share_their_tree() {
    let bytes = fixture("float_shared");
    let names: Vec<String> = parse_grid_list(&bytes).expect("sound").into_iter().map(|g| g.name).collect();
    assert_eq!(names.len(), 4);
    let heat = parse_float_grid(&bytes, "heat", LIMIT).expect("sound");
    assert_eq!((heat.voxel(IVec3::new(-4097, 0, 5000)), heat.active_voxel_count()), (2.0, 1));
    let twin = parse_float_grid(&bytes, "twin", LIMIT).expect("sound");
    assert_eq!(twin.origin(), DVec3::new(-0.125, -0.125, 99.875));
    let density = parse_float_grid(&bytes, "density", LIMIT).expect("sound");
    check_density(&density);
    assert_eq!(density.mass(), twin.mass());
    let error = parse_float_grid(&bytes, "smoke", LIMIT).expect_err("no such grid").to_string();
    assert!(error.contains("\"density\"") && error.contains("\"v\" (Tree_vec3s_5_4_3)"), "{error}");
    let error = parse_float_grid(&bytes, "v", LIMIT).expect_err("not a float grid");
    assert!(matches!(error, VdbProblem::Unsupported { .. }), "{error}");
}

#[test]
fn what_cannot_be_rendered_is_refused_with_a_reason() {
    let bytes = fixture("odd");
    for (name, reason) in [
        ("surface", "level set"),
        ("tilted", "rotates"),
        ("boxes", "cubes"),
        ("negative", "(5, 6, 7) is -1"),
        ("huge", "MiB"),
    ] {
        let error = parse_float_grid(&bytes, name, LIMIT).expect_err(name).to_string();
        assert!(error.contains(reason), "{name}: {error}");
    }
    let affine = parse_float_grid(&bytes, "affine", LIMIT).expect("a scale in a matrix");
    assert_eq!((affine.voxel_size(), affine.origin()), (2.0, DVec3::new(3.0, 4.0, 5.0)));
    let missing = read_float_grid(std::path::Path::new("no/such.vdb"), "density", LIMIT).expect_err("missing");
    assert!(missing.to_string().starts_with("no/such.vdb: "), "{missing}");
}

/// A grid across the corners of the tree's nodes, with many values.
fn noisy() -> DensityGrid {
    let density = |p: WorldPoint| {
        let u =
            Seed(9).uniform(u64::from((p.0.x * 50.0 + 7000.0) as u32) << 32 | u64::from((p.0.y * 5e3 + p.0.z) as u32));
        if u < 0.3 { 0.0 } else { u * 7.0 }
    };
    let origin = WorldPoint::new(-2.0, 0.4, -0.7);
    let near = DensityGrid::from_fn(origin, 0.05, UVec3::new(90, 33, 17), LIMIT, density).expect("small");
    // Over the boundaries of the nodes of 128³ and 4096³ voxels, and to negative voxels.
    let (coords, values): (Vec<IVec3>, Vec<_>) =
        near.occupied_bricks().map(|(b, v)| (b + IVec3::new(-6, 510, -17), v)).unzip();
    DensityGrid::from_bricks(near.origin(), 0.05, &coords, &values, LIMIT).expect("small")
}

fn voxels(grid: &DensityGrid) -> Vec<([i32; 3], f32)> {
    let mut all: Vec<_> = grid
        .occupied_bricks()
        .flat_map(|(b, values)| {
            (0..512).map(move |i| ((b * 8 + curlsmoke::grid::local_voxel(i).as_ivec3()).to_array(), values[i]))
        })
        .filter(|v| v.1 != 0.0)
        .collect();
    all.sort_by_key(|v| v.0);
    all
}

#[test]
fn what_we_write_reads_back_exactly() {
    let grid = noisy();
    for is_zipped in [false, true] {
        let settings = VdbWriteSettings { is_half: false, is_zipped };
        let bytes = write_float_grids(&[("first", &grid), ("density", &grid)], settings);
        assert_eq!(bytes, write_float_grids(&[("first", &grid), ("density", &grid)], settings), "not deterministic");
        let back = parse_float_grid(&bytes, "density", LIMIT).expect("our own file");
        assert_eq!(voxels(&back), voxels(&grid));
        assert!((back.origin() - grid.origin()).abs().max_element() < 1e-12);
        let half = write_float_grids(&[("density", &grid)], VdbWriteSettings { is_half: true, is_zipped });
        let half = parse_float_grid(&half, "density", LIMIT).expect("our own file");
        let rounded: Vec<_> = voxels(&grid).into_iter().map(|(v, d)| (v, half::f16::from_f32(d).to_f32())).collect();
        assert_eq!(voxels(&half), rounded);
    }
    let empty = DensityGrid::from_bricks(DVec3::ZERO, 0.1, &[], &[], LIMIT).expect("nothing");
    let bytes = write_float_grids(&[("density", &empty)], VdbWriteSettings::default());
    assert!(parse_float_grid(&bytes, "density", LIMIT).expect("our own file").is_empty());
}

/// Not a check by itself: leaves files and what is in them for `tests/interop/vdb.sh`, where OpenVDB reads them.
#[test]
fn files_for_openvdb_to_read_are_written() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("vdb");
    std::fs::create_dir_all(&folder).expect("a folder");
    let grid = noisy();
    for (is_half, is_zipped) in [(false, false), (false, true), (true, false), (true, true)] {
        let bytes = write_float_grids(&[("density", &grid), ("again", &grid)], VdbWriteSettings { is_half, is_zipped });
        let name =
            format!("{}_{}.vdb", if is_half { "half" } else { "float" }, if is_zipped { "zip" } else { "plain" });
        std::fs::write(folder.join(name), bytes).expect("writable");
    }
    let lines: String =
        voxels(&grid).iter().map(|(v, d)| format!("{} {} {} {}\n", v[0], v[1], v[2], f64::from(*d))).collect();
    std::fs::write(folder.join("voxels.txt"), lines).expect("writable");
}

/// Small files of every kind.
fn victims() -> Vec<Vec<u8>> {
    let small = DensityGrid::from_fn(WorldPoint::default(), 0.1, UVec3::new(9, 3, 2), LIMIT, |p| p.0.x).expect("small");
    let mut all: Vec<_> = [(false, false), (true, false), (false, true), (true, true)]
        .map(|(is_half, is_zipped)| write_float_grids(&[("density", &small)], VdbWriteSettings { is_half, is_zipped }))
        .into();
    all.extend(["float_blosc", "half_blosc", "float_zip", "half_none", "float_shared"].map(fixture));
    all
}

/// Never a panic, and never memory beyond the limit: the limit is what the allocation is checked against.
fn survive(bytes: &[u8]) {
    let limit = 1 << 24;
    match parse_float_grid(bytes, "density", limit) {
        Ok(grid) => assert!(grid.memory_bytes() <= limit),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

#[test]
fn truncated_files_are_errors() {
    for bytes in victims() {
        let ends = (0..600).chain((600..bytes.len()).step_by(bytes.len() / 100 + 1)).filter(|&e| e < bytes.len());
        for end in ends {
            survive(&bytes[..end]);
        }
        assert!(parse_float_grid(&bytes[..bytes.len() / 2], "density", LIMIT).is_err());
    }
}

#[test]
fn files_with_changed_bytes_do_no_harm() {
    for (n, bytes) in victims().into_iter().enumerate() {
        let seed = Seed(77).derive(n as u64);
        for round in 0..80u64 {
            let mut bytes = bytes.clone();
            for k in 0..1 + round % 4 {
                let word = seed.word(round * 8 + k);
                // Half of the changes hit the header and the transform, where the counts are.
                let span = if word & 1 == 0 { bytes.len().min(700) } else { bytes.len() };
                let at = (word >> 8) as usize % span;
                match (word >> 1) % 4 {
                    0 => bytes[at] = 0xff,
                    1 => bytes[at] ^= 1 << (word >> 61),
                    2 => bytes[at] = (word >> 50) as u8,
                    _ => bytes[at..].iter_mut().take(4).for_each(|b| *b = 0x7f),
                }
            }
            survive(&bytes);
        }
    }
}

#[test]
fn nonsense_counts_are_refused_before_memory_is_taken() {
    let small = DensityGrid::from_fn(WorldPoint::default(), 0.1, UVec3::splat(2), LIMIT, |_| 1.0).expect("small");
    let bytes = write_float_grids(&[("density", &small)], VdbWriteSettings { is_half: false, is_zipped: false });
    // Every aligned or unaligned word of the header and root replaced by absurd numbers.
    for at in 0..900.min(bytes.len() - 8) {
        for number in [u64::MAX, i64::MAX as u64, 1 << 40, 0x7fff_ffff, 0x8000_0000, 0xffff_f000_ffff_f000] {
            let mut bytes = bytes.clone();
            bytes[at..at + 8].copy_from_slice(&number.to_le_bytes());
            survive(&bytes);
        }
    }
}

#[test]
fn tiny_negative_densities_are_zero_and_others_are_errors() {
    let two = |small: f32| {
        let one = DensityGrid::from_fn(WorldPoint::default(), 1.0, UVec3::new(2, 1, 1), LIMIT, |p| {
            if p.0.x < 1.0 { 1.0 } else { 0.123 }
        });
        let bytes = write_float_grids(
            &[("density", &one.expect("small"))],
            VdbWriteSettings { is_half: false, is_zipped: false },
        );
        let from = 0.123f32.to_le_bytes();
        let at = bytes.windows(4).rposition(|w| w == from).expect("the value is in the file");
        let mut bytes = bytes;
        bytes[at..at + 4].copy_from_slice(&small.to_le_bytes());
        parse_float_grid(&bytes, "density", LIMIT)
    };
    assert_eq!(two(-1e-7).expect("negligible").active_voxel_count(), 1);
    for bad in [-1e-3, f32::NAN, f32::INFINITY] {
        let error = two(bad).expect_err("not a density");
        assert!(matches!(error, VdbProblem::Grid { error: GridError::BadDensity { .. }, .. }), "{error}");
        assert!(error.to_string().contains("voxel (1, 0, 0)"), "{error}");
    }
}
