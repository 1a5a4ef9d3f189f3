//! Makes the meshes of the gallery: `cargo run --example make_meshes` writes `scenes/meshes/stone.obj`.
//!
//! The stone is a pierced form: a twisted, three-lobed ovoid with an oblique hole, the zero set of a smooth function,
//! meshed by surface nets (Gibson 1998, *Constrained Elastic Surface Nets*) whose vertices are moved onto the set.

use curlsmoke::geometry::mesh_file::parse_mesh;
use glam::{DVec3, UVec3};
use std::collections::HashMap;
use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;

/// Edge of a cell [m]: with it the file has some 18,000 triangles.
const CELL: f64 = 0.0148;

/// Half the size of the region searched [m].
const HALF: DVec3 = DVec3::new(0.42, 0.50, 0.42);

/// Negative inside; its gradient is roughly 1.
fn stone(p: DVec3) -> f64 {
    let s = p.y / 0.42;
    let (sin, cos) = (1.35 * s).sin_cos();
    let (x, z) = (p.x - 0.055 * (2.4 * s + 0.3).sin(), p.z + 0.03 * (1.7 * s).sin());
    let (u, v) = (cos * x + sin * z, cos * z - sin * x);
    let rho_sq = u * u + v * v;
    // The cosine of three times the angle about the axis, faded out near it, where it has no limit.
    let lobes = (u * u * u - 3.0 * u * v * v) / (rho_sq * (rho_sq + 1e-4).sqrt() + 1e-6) * rho_sq / (rho_sq + 0.01);
    let (a, b) = (0.285 * (1.0 - 0.16 * s), 0.215 * (1.0 + 0.06 * s));
    let swell = 1.0 + 0.13 * lobes;
    let body = ((u / (a * swell)).powi(2) + (v / (b * swell)).powi(2) + s * s).sqrt() - 1.0;

    let through = DVec3::new(0.22, 0.18, 1.0).normalize();
    let up = DVec3::Y.reject_from_normalized(through).normalize();
    let from_hole = p - DVec3::new(0.03, 0.09, 0.0);
    let hole = 1.0 - (from_hole.dot(up.cross(through)) / 0.085).hypot(from_hole.dot(up) / 0.135);

    // The larger of the two, rounded where they meet.
    let (body, hole) = (0.22 * body, 0.1 * hole);
    0.5 * (body + hole + (body - hole).hypot(0.05))
}

fn gradient(p: DVec3) -> DVec3 {
    let h = 1e-5;
    DVec3::from_array(DVec3::AXES.map(|axis| (stone(p + axis * h) - stone(p - axis * h)) / (2.0 * h)))
}

struct Net {
    vertices: Vec<DVec3>,
    quads: Vec<[usize; 4]>,
}

fn surface_net() -> Net {
    let cells = (2.0 * HALF / CELL).ceil().as_uvec3();
    let position = |p: UVec3| p.as_dvec3() * CELL - HALF;
    let samples: Vec<f64> = (0..=cells.z)
        .flat_map(|z| (0..=cells.y).flat_map(move |y| (0..=cells.x).map(move |x| UVec3::new(x, y, z))))
        .map(|p| stone(position(p)))
        .collect();
    let at = |p: UVec3| samples[(((p.z * (cells.y + 1)) + p.y) * (cells.x + 1) + p.x) as usize];

    let mut net = Net { vertices: Vec::new(), quads: Vec::new() };
    let mut vertex_of = HashMap::new();
    let corners: Vec<UVec3> = (0..8).map(|i| UVec3::new(i & 1, i >> 1 & 1, i >> 2)).collect();
    for z in 0..cells.z {
        for y in 0..cells.y {
            for x in 0..cells.x {
                let cell = UVec3::new(x, y, z);
                let mut crossings = Vec::new();
                for (i, a) in corners.iter().enumerate() {
                    for b in corners[i + 1..].iter().filter(|b| (a.as_ivec3() - b.as_ivec3()).length_squared() == 1) {
                        let (p, q) = (cell + a, cell + b);
                        let (fp, fq) = (at(p), at(q));
                        if (fp < 0.0) != (fq < 0.0) {
                            crossings.push(position(p).lerp(position(q), fp / (fp - fq)));
                        }
                    }
                }
                if crossings.is_empty() {
                    continue;
                }
                let mut vertex = crossings.iter().sum::<DVec3>() / crossings.len() as f64;
                for _ in 0..4 {
                    let g = gradient(vertex);
                    vertex -= g * (stone(vertex) / g.length_squared());
                }
                vertex_of.insert(cell, net.vertices.len());
                net.vertices.push(vertex);
            }
        }
    }
    // Round each edge of the lattice that the surface crosses lie four cells.
    for z in 1..cells.z {
        for y in 1..cells.y {
            for x in 1..cells.x {
                let p = UVec3::new(x, y, z);
                for axis in 0..3 {
                    let unit = |axis: usize| UVec3::AXES[axis % 3];
                    let (inside, next_inside) = (at(p) < 0.0, at(p + unit(axis)) < 0.0);
                    if inside == next_inside {
                        continue;
                    }
                    let (u, v) = (unit(axis + 1), unit(axis + 2));
                    let mut quad = [p, p - u, p - u - v, p - v].map(|cell| vertex_of[&cell]);
                    if !inside {
                        quad.reverse();
                    }
                    net.quads.push(quad);
                }
            }
        }
    }
    net
}

fn main() -> Result<(), Box<dyn Error>> {
    let net = surface_net();
    let mut text = String::from("# A pierced stone, made by examples/make_meshes.rs of curlsmoke.\no stone\n");
    for p in &net.vertices {
        writeln!(text, "v {:.5} {:.5} {:.5}", p.x, p.y, p.z)?;
    }
    for p in &net.vertices {
        let n = gradient(*p).normalize();
        writeln!(text, "vn {:.4} {:.4} {:.4}", n.x, n.y, n.z)?;
    }
    for quad in &net.quads {
        let [a, b, c, d] = quad.map(|i| i + 1);
        writeln!(text, "f {a}//{a} {b}//{b} {c}//{c} {d}//{d}")?;
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes/stone.obj");
    let mesh = parse_mesh(text.as_bytes(), &path)?;
    if !mesh.report().is_clean() || mesh.triangles().len() > 20_000 || text.len() > 1 << 20 {
        return Err(format!("the stone is not what it should be: {}, {} bytes", mesh.report(), text.len()).into());
    }
    std::fs::create_dir_all(path.parent().ok_or("no folder")?)?;
    std::fs::write(path, text)?;
    Ok(())
}
