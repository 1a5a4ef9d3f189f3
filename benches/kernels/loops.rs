//! Little loops that do one thing: the clock that kernels are measured in, and the bounds that a processor sets.

use crate::workload::Workload;
use curlsmoke::math::hash::Seed;
use curlsmoke::math::lanes::{Batch, Kernel, run_kernel};
use std::hint::black_box;

/// Instructions that each wait for the one before, of a cycle each on every processor of today: so many cycles a run.
pub fn cycles() -> Workload {
    const LINKS: usize = 1 << 17;
    Workload::new(2 * LINKS, || {
        // Hidden from the compiler, and in turns, so that no two links can be made one.
        let (term, mask) = (black_box(0x9E37_79B9_u64), black_box(0x7F4A_7C15_u64));
        let mut x = black_box(1u64);
        for _ in 0..LINKS {
            x = x.wrapping_add(term) ^ mask;
        }
        black_box(x);
    })
}

/// Chains side by side, more than there are arithmetic units: how many instructions can be had in a cycle. Of several kinds,
/// or the compiler makes vectors of them. An operation is a link; instructions are for callgrind to count.
pub fn integer_instructions() -> Workload {
    const LINKS: usize = 1 << 15;
    Workload::new(LINKS, || {
        let (a, b) = (black_box(0x9E37_79B9_u64), black_box(0x7F4A_7C15_u64));
        let mut x: [u64; 9] = std::array::from_fn(|i| black_box(i as u64));
        for _ in 0..LINKS {
            x[0] = x[0].wrapping_add(a) ^ b;
            x[1] = (x[1] ^ a).wrapping_sub(b);
            x[2] = (x[2] | a).wrapping_add(b);
            x[3] = x[3].wrapping_sub(b) & a;
            x[4] = (x[4] & b) ^ a;
            x[5] = x[5].wrapping_add(b) | a;
            x[6] = (x[6] ^ b).wrapping_add(a);
            x[7] = x[7].wrapping_sub(a) ^ b;
            x[8] = (x[8] | b).wrapping_sub(a);
        }
        black_box(x);
    })
}

/// As many multiply-adds as the processor can start, in the widest lanes it has; an operation is one of a lane.
pub fn multiply_adds() -> Workload {
    let (_, width) = run_kernel(MultiplyAdds);
    Workload::new(CHAINS * LINKS * width, || {
        black_box(run_kernel(MultiplyAdds));
    })
}

/// Lanes side by side.
pub fn lane_width() -> usize {
    run_kernel(MultiplyAdds).1
}

const CHAINS: usize = 16;
const LINKS: usize = 1 << 12;

struct MultiplyAdds;

impl Kernel for MultiplyAdds {
    /// A number that depends on all, and how many there are side by side.
    type Output = (f64, usize);
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "an iterator's methods are not certain to be inlined")]
    fn run<L: Batch>(self, zero: L) -> (f64, usize) {
        let (factor, term) = (zero.lit(black_box(0.999)), zero.lit(black_box(0.001)));
        let mut chains = [zero.lit(0.5); CHAINS];
        for _ in 0..LINKS {
            for k in 0..CHAINS {
                chains[k] = factor.mul_add(chains[k], term);
            }
        }
        let mut sum = chains[0];
        for k in 1..CHAINS {
            sum = sum + chains[k];
        }
        (sum.lane(0), L::WIDTH)
    }
}

/// A cache line whose first word says which comes next.
type Line = [u32; 16];

/// Lines of `bytes` in all that form one ring in random order (Sattolo 1986).
fn ring(bytes: usize) -> Vec<Line> {
    let mut next: Vec<u32> = (0..(bytes / size_of::<Line>()) as u32).collect();
    let seed = Seed(7);
    for i in (1..next.len()).rev() {
        next.swap(i, (seed.word(i as u64) % i as u64) as usize);
    }
    next.into_iter().map(|n| [n; 16]).collect()
}

/// Loads that each wait for the one before, all over an array of `bytes`, in `WAYS` rings at once.
fn loads<const WAYS: usize>(bytes: usize) -> Workload {
    const LOADS: usize = 1 << 14;
    let lines = ring(bytes);
    // Anywhere on the ring, far apart by chance.
    let mut at: [u32; WAYS] = std::array::from_fn(|way| (way * lines.len() / WAYS) as u32);
    Workload::new(LOADS * WAYS, move || {
        for _ in 0..LOADS {
            for place in &mut at {
                *place = lines[*place as usize][0];
            }
        }
        black_box(&at);
    })
}

/// One load after the other: how long each takes.
pub fn dependent_loads(bytes: usize) -> Workload {
    loads::<1>(bytes)
}

/// Eight at a time: how often one can be had.
pub fn independent_loads(bytes: usize) -> Workload {
    loads::<8>(bytes)
}

/// Branches; where `is_random`, half of them are taken and nothing tells which.
pub fn branches(is_random: bool) -> Workload {
    const BRANCHES: usize = 1 << 15;
    let mut x = Seed(11).word(0) | 1;
    Workload::new(BRANCHES, move || {
        let bound = black_box(if is_random { 1 << 63 } else { u64::MAX });
        let mut taken = 0u64;
        for _ in 0..BRANCHES {
            // Marsaglia's, so that the sequence never repeats and nobody can learn it.
            x ^= x << 13;
            x ^= x >> 7;
            x ^= x << 17;
            if x < bound {
                // What the compiler may not do ahead of the decision.
                taken = black_box(taken + 1);
            }
        }
        black_box(taken);
    })
}
