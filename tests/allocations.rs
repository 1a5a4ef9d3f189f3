//! The field of the next step of particles asks for no memory.

#![allow(unsafe_code, reason = "an allocator that counts is one")]

use curlsmoke::flow::{NoFiles, VelocityField};
use curlsmoke::geometry::Geometry;
use curlsmoke::progress::Silent;
use curlsmoke::scene::Scene;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;

struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: all work is the system's.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // Not counted while a thread ends and has no counter any more.
        let _ = COUNT.try_with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(work: impl FnOnce()) -> usize {
    let before = COUNT.with(Cell::get);
    work();
    COUNT.with(Cell::get) - before
}

#[test]
fn the_field_of_the_next_step_needs_no_memory() {
    let text = "
version: 1
camera: {position: [0, 1, 5], look_at: [0, 1, 0]}
lights: [{environment: {radiance: [1, 1, 1]}}]
shapes:
  ball: {sphere: {center: [0, 1, 0], radius: 0.3}}
  bar:
    box: {center: [1, 1, 0], size: [0.2, 0.8, 0.2]}
    motion: {keys: [{time: 0}, {time: 1, translate: [0.3, 0, 0], rotate_deg: {axis: [0, 0, 1], angle: 70}}]}
  ring: {torus: {center: [-1, 1, 0], major_radius: 0.4, minor_radius: 0.1}}
  ground: {plane: {}}
flow:
  potentials:
    - uniform: {velocity: [0.1, 0.5, 0], modulate: [{shape: {name: bar, from: 0.5, to: 0.1}}]}
    - noise: {length_scale: 0.5, speed: 0.3, octaves: 3, spin_rate: 0.2, memory: 0.5}
    - vortex_ring: {center: [0, 0.4, 0], radius: 0.3, core: 0.1, speed: 1}
  obstacles: [ball, bar, ring, ground]
";
    let scene = Scene::from_text(text, Path::new("test.yaml")).unwrap_or_else(|e| panic!("{e}"));
    let geometry = Geometry::build(&scene, &Silent).expect("primitives can be built");
    let field = VelocityField::build(&scene, &geometry, &NoFiles).expect("no files are named");
    let mut found = 0.0f64;
    let of_first = allocations(|| found += field.span(0.0, 0.04).velocity([0.1, 0.9, 0.4], 0.5)[1]);
    let mut span = field.span(0.0, 0.04);
    let of_more = allocations(|| {
        for n in 1..100 {
            span.renew(f64::from(n) * 0.04, 0.04);
            found += span.velocity([0.1, 0.9, 0.4], 0.5)[1];
        }
    });
    assert!(found.is_finite() && of_first > 0);
    // What is renewed is what is new.
    let fresh = field.span(99.0 * 0.04, 0.04);
    for p in [[0.1, 0.9, 0.4], [1.2, 1.3, 0.1], [-0.7, 1.1, 0.2], [0.3, 0.1, -0.4]] {
        assert_eq!(span.velocity(p, 0.3), fresh.velocity(p, 0.3));
    }
    assert_eq!(of_more, 0, "allocations in 99 steps");
}
