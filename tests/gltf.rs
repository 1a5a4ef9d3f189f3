//! Shapes of glTF files: how their nodes move them, what is refused, and that no file, however broken, brings a program down.

use curlsmoke::geometry::Geometry;
use curlsmoke::geometry::gltf_file::buffer_files;
use curlsmoke::progress::Silent;
use curlsmoke::scene::Scene;
use glam::DVec3;
use std::path::Path;

/// A .glb of a tetrahedron in a node `blade` that is scaled and moved inside of a node `arm` that turns a quarter in a second,
/// inside of a node `base` that is carried along.
fn glb(json_change: impl FnOnce(String) -> String) -> Vec<u8> {
    let floats = |v: &[f32]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let mut bin = floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.]);
    bin.extend([0u16, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    bin.extend(floats(&[0.0, 1.0]));
    bin.extend(floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, half, half]));
    bin.extend(floats(&[0.0, 0.0, 0.0, 0.0, 2.0, 0.0]));
    let json = json_change(format!(
        r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}],
        "nodes": [{{"name": "base", "children": [1]}}, {{"name": "arm", "children": [2], "translation": [1, 0, 0]}},
            {{"name": "blade", "mesh": 0, "translation": [0, 0, 1], "scale": [2, 1, 1]}}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]}},
            {{"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"}},
            {{"bufferView": 2, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1]}},
            {{"bufferView": 3, "componentType": 5126, "count": 2, "type": "VEC4"}},
            {{"bufferView": 4, "componentType": 5126, "count": 2, "type": "VEC3"}}],
        "bufferViews": [{{"buffer": 0, "byteOffset": 0, "byteLength": 48}}, {{"buffer": 0, "byteOffset": 48, "byteLength": 24}},
            {{"buffer": 0, "byteOffset": 72, "byteLength": 8}}, {{"buffer": 0, "byteOffset": 80, "byteLength": 32}},
            {{"buffer": 0, "byteOffset": 112, "byteLength": 24}}],
        "buffers": [{{"byteLength": {}}}],
        "animations": [{{"channels": [{{"sampler": 0, "target": {{"node": 1, "path": "rotation"}}}},
                {{"sampler": 1, "target": {{"node": 0, "path": "translation"}}}}],
            "samplers": [{{"input": 2, "output": 3, "interpolation": "LINEAR"}}, {{"input": 2, "output": 4}}]}}]}}"#,
        bin.len()
    ));
    let mut json = json.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    out.extend(2u32.to_le_bytes());
    out.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &bin)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

fn scene_in(folder: &Path, transform: &str, more: &str) -> Scene {
    let yaml = format!(
        "version: 1\nframes: {{first: 1, last: 25, fps: 24}}\ncamera: {{position: [0, 0, 9], look_at: [0, 0, 0]}}\n\
         lights: [{{environment: {{radiance: [1, 1, 1]}}}}]\n\
         shapes: {{arm: {{mesh: {{file: arm.glb}}, transform: {transform}}}}}\n{more}"
    );
    Scene::from_text(&yaml, &folder.join("test.yaml")).unwrap_or_else(|e| panic!("{e}"))
}

fn geometry_with(bytes: &[u8], transform: &str, more: &str) -> Result<Geometry, String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("arm.glb"), bytes).unwrap();
    Geometry::build(&scene_in(folder.path(), transform, more), &Silent).map_err(|e| e.to_string())
}

fn gltf_geometry(bytes: &[u8], transform: &str) -> Result<Geometry, String> {
    geometry_with(bytes, transform, "")
}

#[test]
fn nodes_of_gltf_move_the_shape_through_their_hierarchy() {
    let geometry =
        gltf_geometry(&glb(|json| json), "{scale: 0.5, translate: [0, 0, 3]}").unwrap_or_else(|e| panic!("{e}"));
    for time in [0.0, 0.25, 0.6, 1.0, 7.0f64] {
        let share = time.min(1.0);
        let (sin, cos) = (share * std::f64::consts::FRAC_PI_2).sin_cos();
        let there = geometry.at(time);
        let mesh = there.shapes[0].mesh.as_ref().unwrap();
        let found: Vec<DVec3> = mesh.positions().iter().map(|p| p.as_dvec3()).collect();
        for corner in [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z] {
            let blade = corner * DVec3::new(2.0, 1.0, 1.0) + DVec3::Z;
            let arm = DVec3::new(blade.x * cos - blade.y * sin + 1.0, blade.x * sin + blade.y * cos, blade.z);
            let expected = 0.5 * (arm + DVec3::Y * 2.0 * share) + DVec3::Z * 3.0;
            let off = found.iter().map(|p| p.distance(expected)).fold(f64::INFINITY, f64::min);
            assert!(off < 1e-5, "{time}: {expected} is off by {off}");
        }
    }
}

#[test]
fn what_is_not_read_of_gltf_is_named_and_broken_files_are_errors() {
    let swap = |from: &'static str, to: &'static str| {
        glb(move |json| {
            assert!(json.contains(from), "{from}");
            json.replacen(from, to, 1)
        })
    };
    for (from, to, part) in [
        (r#""interpolation": "LINEAR""#, r#""interpolation": "CUBICSPLINE""#, "cubic splines"),
        (r#""indices": 1}"#, r#""indices": 1, "targets": [{"POSITION": 0}]}"#, "morph targets"),
        (r#""mesh": 0,"#, r#""mesh": 0, "skin": 0,"#, "skin"),
        (r#""translation": [1, 0, 0]"#, r#""scale": [1, 2, 1]"#, "scaled by"),
        (r#""indices": 1}"#, r#""indices": 1, "mode": 1}"#, "only plain triangles"),
        (r#""byteOffset": 112, "byteLength": 24"#, r#""byteOffset": 112, "byteLength": 20"#, "beyond its buffer"),
        (r#""count": 12"#, r#""count": 13"#, "beyond its buffer"),
        (
            r#""asset": "#,
            r#""extensionsRequired": ["KHR_draco_mesh_compression"], "asset": "#,
            "KHR_draco_mesh_compression",
        ),
        (r#""name": "blade","#, r#""name": "blade", "children": [0],"#, "inside of"),
    ] {
        let mut bytes = swap(from, to);
        if part == "skin" {
            bytes = glb(|json| {
                let json = json.replacen(from, to, 1);
                json.replacen(r#""meshes""#, r#""skins": [{"joints": [0]}], "meshes""#, 1)
            });
        }
        let error = gltf_geometry(&bytes, "{}").err().unwrap_or_else(|| panic!("{to} is accepted"));
        assert!(error.contains(part) && error.contains("arm.glb"), "{part}: {error}");
    }
    let whole = glb(|json| json);
    for length in (0..whole.len()).step_by(7) {
        assert!(gltf_geometry(&whole[..length], "{}").is_err(), "{length} bytes are accepted");
    }
}

/// Begin and end of each number in a text.
fn numbers_of(text: &str) -> Vec<(usize, usize)> {
    let mut found: Vec<(usize, usize)> = Vec::new();
    let mut is_text = false;
    for (i, c) in text.char_indices() {
        is_text ^= c == '"';
        let is_part = !is_text && (c.is_ascii_digit() || c == '.');
        match found.last_mut() {
            Some((_, end)) if is_part && *end == i => *end = i + 1,
            _ if is_part => found.push((i, i + 1)),
            _ => {}
        }
    }
    found
}

#[test]
fn whatever_numbers_a_file_has_it_is_a_mesh_or_an_error() {
    let mut numbers = 0;
    glb(|json| {
        numbers = numbers_of(&json).len();
        json
    });
    assert!(numbers > 60, "{numbers}");
    let others = ["0", "1", "5", "7", "255", "5122", "5126", "-1", "4294967295", "18446744073709551615", "1e30", "0.5"];
    let (mut errors, mut meshes) = (0, 0);
    for n in 0..numbers {
        for other in others {
            let bytes = glb(|json| {
                let (begin, end) = numbers_of(&json)[n];
                format!("{}{other}{}", &json[..begin], &json[end..])
            });
            match gltf_geometry(&bytes, "{}") {
                Ok(_) => meshes += 1,
                Err(error) => {
                    assert!(!error.contains("the library that reads glTF fails"), "number {n} as {other}: {error}");
                    errors += 1;
                }
            }
        }
    }
    println!("of {numbers} numbers, {} others each: {errors} errors, {meshes} meshes", others.len());
    assert!(errors > 100 && meshes > 50, "{errors} {meshes}");
}

#[test]
fn whatever_bytes_a_file_has_it_is_a_mesh_or_an_error() {
    let whole = glb(|json| json);
    let mut state = 12345u64;
    let mut next = || {
        // Knuth's MMIX generator: the same on every run.
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize
    };
    for round in 0..600 {
        let mut bytes = whole.clone();
        for _ in 0..1 + round % 3 {
            // Of every third the head, which says how long what is.
            let among = if round % 3 == 0 { 24 } else { bytes.len() };
            let at = next() % among;
            bytes[at] = next() as u8;
        }
        if let Err(error) = gltf_geometry(&bytes, "{}") {
            assert!(!error.contains("the library that reads glTF fails"), "round {round}: {error}");
        }
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("arm.glb"), &bytes).unwrap();
        buffer_files(&folder.path().join("arm.glb"), 1 << 30);
    }
}

#[test]
fn a_shape_that_carries_something_neither_grows_nor_jumps_by_its_file() {
    let grows = glb(|json| {
        json.replacen(
            r#""sampler": 1, "target": {"node": 0, "path": "translation"}"#,
            r#""sampler": 1, "target": {"node": 0, "path": "scale"}"#,
            1,
        )
    });
    // The values of the second sampler as scales.
    let floats = |v: [f32; 6]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let scaled = |last: f32| {
        let mut bytes = grows.clone();
        let (old, new) = (floats([0.0, 0.0, 0.0, 0.0, 2.0, 0.0]), floats([1.0, 1.0, 1.0, last, last, last]));
        let at = bytes.windows(24).rposition(|window| window == old).unwrap();
        bytes[at..at + 24].copy_from_slice(&new);
        bytes
    };
    let jumps = glb(|json| json.replacen(r#""LINEAR""#, r#""STEP""#, 1));
    let carrying = [
        "flow: {potentials: [{uniform: {velocity: [0, 1, 0]}}], obstacles: [arm]}\n",
        "volumes: {mist: {inside: arm, density: 1, medium: {extinction: 1}}}\n",
        "smoke: {emitters: [{mesh: {shape: arm}, rate: 100, lifetime: 1}], grid: {voxel_size: 0.1}, medium: {extinction: 1}}\n",
    ];
    for (bytes, part) in [(scaled(2.0), "grow"), (jumps, "jump")] {
        geometry_with(&bytes, "{}", "").unwrap_or_else(|e| panic!("what light alone meets may {part}: {e}"));
        for more in carrying {
            let error = geometry_with(&bytes, "{}", more).err().unwrap_or_else(|| panic!("{part}: {more}"));
            assert!(error.contains(part) && error.contains("test.yaml:5:") && error.contains("arm.glb"), "{error}");
        }
    }
    for more in carrying {
        geometry_with(&glb(|json| json), "{}", more).unwrap_or_else(|e| panic!("moves evenly: {e}"));
        geometry_with(&scaled(1.00001), "{}", more).unwrap_or_else(|e| panic!("rounding is no growth: {e}"));
    }
}

/// A .gltf of one triangle whose buffer is `uri`.
fn triangle(uri: &str) -> String {
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "buffers": [{{"uri": "{uri}", "byteLength": 36}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 36}}], "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}}}]}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}}],
        "nodes": [{{"mesh": 0}}], "scenes": [{{"nodes": [0]}}], "scene": 0}}"#
    )
}

fn read(file: &Path, limit: u64) -> Result<usize, String> {
    curlsmoke::geometry::mesh_file::read_body(file, None, limit)
        .map(|(mesh, _)| mesh.triangles().len())
        .map_err(|e| e.to_string())
}

#[cfg(unix)]
#[test]
fn buffers_without_an_end_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.gltf");
    let pipe = folder.path().join("pipe");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(made.success());
    for uri in ["/dev/zero", "pipe"] {
        std::fs::write(&file, triangle(uri)).unwrap();
        let error = read(&file, 1 << 30).unwrap_err();
        assert!(error.contains("no regular file") && error.contains(uri), "{error}");
    }
    let error = read(&pipe, 1 << 30).unwrap_err();
    assert!(error.contains("none of") || error.contains("no regular file"), "{error}");
    assert!(buffer_files(&pipe, 1 << 30).is_empty());
}

#[test]
fn all_that_is_read_counts_against_the_memory_limit() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.gltf");
    let bytes: Vec<u8> =
        [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    std::fs::write(folder.path().join("b.bin"), &bytes).unwrap();
    std::fs::write(&file, triangle("b.bin")).unwrap();
    let json_limit = 48 * std::fs::metadata(&file).unwrap().len();
    assert_eq!(read(&file, json_limit), Ok(1));
    // The numbers of many points take more than their buffer.
    let count = 3 * 20_000;
    let points = bytes.repeat(count / 3);
    std::fs::write(folder.path().join("b.bin"), &points).unwrap();
    let text = triangle("b.bin").replace(r#""count": 3"#, &format!(r#""count": {count}"#));
    std::fs::write(&file, text.replace(r#""byteLength": 36"#, &format!(r#""byteLength": {}"#, points.len()))).unwrap();
    assert_eq!(read(&file, 16 << 20), Ok(count / 3));
    let error = read(&file, 4 << 20).unwrap_err();
    assert!(error.contains("its numbers need more"), "{error}");
    // A buffer that is longer than the limit leaves.
    std::fs::write(&file, triangle("b.bin")).unwrap();
    std::fs::write(folder.path().join("b.bin"), vec![0; 1 << 20]).unwrap();
    let error = read(&file, 1 << 19).unwrap_err();
    assert!(error.contains("b.bin") && error.contains("leaves"), "{error}");
}

#[test]
fn the_files_of_buffers_are_known_of_both_endings() {
    let folder = tempfile::tempdir().unwrap();
    let json = triangle("b%20c.bin");
    std::fs::write(folder.path().join("a.gltf"), &json).unwrap();
    let mut binary = b"glTF".to_vec();
    let mut chunk = json.into_bytes();
    chunk.resize(chunk.len().next_multiple_of(4), b' ');
    binary.extend(2u32.to_le_bytes());
    binary.extend((20 + chunk.len() as u32).to_le_bytes());
    binary.extend((chunk.len() as u32).to_le_bytes());
    binary.extend(b"JSON");
    binary.extend(chunk);
    std::fs::write(folder.path().join("a.glb"), &binary).unwrap();
    for name in ["a.gltf", "a.glb"] {
        assert_eq!(buffer_files(&folder.path().join(name), 1 << 30), [folder.path().join("b c.bin")], "{name}");
    }
}

#[test]
fn deep_and_wide_trees_of_nodes_take_no_longer_than_they_are_large() {
    let folder = tempfile::tempdir().unwrap();
    let bytes: Vec<u8> =
        [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    std::fs::write(folder.path().join("b.bin"), bytes).unwrap();
    let seconds = |count: usize| {
        let chain: String = (1..count).map(|i| format!(r#"{{"mesh": 0, "children": [{i}]}}, "#)).collect();
        let text =
            triangle("b.bin").replace(r#""nodes": [{"mesh": 0}]"#, &format!(r#""nodes": [{chain}{{"mesh": 0}}]"#));
        let file = folder.path().join("a.gltf");
        std::fs::write(&file, text).unwrap();
        let start = std::time::Instant::now();
        assert_eq!(read(&file, 1 << 32), Ok(count));
        start.elapsed().as_secs_f64()
    };
    seconds(1000);
    let (few, many) = (seconds(4000), seconds(64_000));
    println!("{few:.3} s for 4000 nodes, {many:.3} s for 64000");
    // Sixteen times as many; what grows as their square would take 256 times as long.
    assert!(many < 80.0 * few.max(0.002), "{few} {many}");
}
