//! Masks of shapes by name (Friedman and Jones 2015, *Fully automatic ID mattes with support for motion blur and
//! transparency*; file format of the Cryptomatte specification 1.2).
//!
//! Each pixel lists the shapes that its paths met first with the share of the paths that did. Smoke before a shape takes its
//! share, as the background does.

/// Name of the layers in a file, and of the set of masks.
pub const NAME: &str = "CryptoObject";

/// Shapes that a pixel can list: two in each layer of four channels.
pub const RANKS: usize = 6;

/// The number by which a name goes: its hash, which must be that of an ordinary f32.
pub fn id(name: &str) -> u32 {
    let hash = murmur3(name.as_bytes(), 0);
    // Where all bits of the exponent are equal, the number would be none, infinite or denormal.
    let exponent = (hash >> 23) & 255;
    if exponent == 0 || exponent == 255 { hash ^ (1 << 23) } else { hash }
}

/// Attributes of a file: key within it and text, from the names of all shapes.
pub fn attributes(names: &[String]) -> Vec<(String, String)> {
    let prefix = format!("cryptomatte/{}", &format!("{:08x}", id(NAME))[..7]);
    // Names of shapes have nothing that JSON escapes.
    let entries: Vec<String> = names.iter().map(|name| format!("\"{name}\":\"{:08x}\"", id(name))).collect();
    let manifest = format!("{{{}}}", entries.join(","));
    [("name", NAME), ("hash", "MurmurHash3_32"), ("conversion", "uint32_to_float32"), ("manifest", &manifest)]
        .map(|(key, text)| (format!("{prefix}/{key}"), text.to_string()))
        .to_vec()
}

/// How many paths of a pixel met each shape first.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Coverage(Vec<(u32, u32)>);

impl Coverage {
    /// Adds paths that met a shape first.
    pub fn add(&mut self, shape_idx: u32, count: u32) {
        match self.0.iter_mut().find(|(known, _)| *known == shape_idx) {
            Some((_, sum)) => *sum = sum.saturating_add(count),
            None => self.0.push((shape_idx, count)),
        }
    }

    /// Shapes that were met, and by how many paths each.
    pub fn counts(&self) -> impl ExactSizeIterator<Item = (u32, u32)> + '_ {
        self.0.iter().copied()
    }

    /// The numbers and shares of the shapes that cover most, of `count` paths; `ids` are the numbers of all shapes.
    pub fn ranked(&self, ids: &[u32], count: f64) -> [f32; 2 * RANKS] {
        let mut sorted = self.0.clone();
        sorted.sort_by_key(|&(shape_idx, count)| (std::cmp::Reverse(count), shape_idx));
        let mut ranked = [0.0; 2 * RANKS];
        for (pair, (shape_idx, sum)) in ranked.chunks_mut(2).zip(sorted) {
            pair[0] = f32::from_bits(ids[shape_idx as usize]);
            pair[1] = (f64::from(sum) / count) as f32;
        }
        ranked
    }
}

/// MurmurHash3, 32 bits, for x86 (Appleby 2008).
fn murmur3(data: &[u8], seed: u32) -> u32 {
    let scramble = |k: u32| k.wrapping_mul(0xcc9e_2d51).rotate_left(15).wrapping_mul(0x1b87_3593);
    let mut hash = seed;
    let chunks = data.chunks_exact(4);
    let tail = chunks.remainder();
    for chunk in chunks {
        let k = u32::from_le_bytes(chunk.try_into().expect("four bytes"));
        hash = (hash ^ scramble(k)).rotate_left(13).wrapping_mul(5).wrapping_add(0xe654_6b64);
    }
    if !tail.is_empty() {
        hash ^= scramble(tail.iter().rev().fold(0, |k, &byte| (k << 8) | u32::from(byte)));
    }
    hash ^= data.len() as u32;
    hash = (hash ^ (hash >> 16)).wrapping_mul(0x85eb_ca6b);
    hash = (hash ^ (hash >> 13)).wrapping_mul(0xc2b2_ae35);
    hash ^ (hash >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_that_others_make() {
        // Published test values of the hash.
        assert_eq!(murmur3(b"", 0), 0);
        assert_eq!(murmur3(b"", 1), 0x514e_28b7);
        assert_eq!(murmur3(b"test", 0), 0xba6b_d213);
        assert_eq!(murmur3(b"Hello, world!", 0), 0xc036_3e43);
        assert_eq!(murmur3(b"The quick brown fox jumps over the lazy dog", 0), 0x2e4f_f723);
        for name in (0..5000).map(|i| format!("shape{i}")) {
            assert!(f32::from_bits(id(&name)).is_normal(), "{name}");
        }
    }

    #[test]
    fn shapes_are_listed_by_what_they_cover() {
        let mut coverage = Coverage::default();
        for shape_idx in [2, 0, 2, 2, 1, 2, 0] {
            coverage.add(shape_idx, 1);
        }
        let ids = ["a", "b", "c"].map(id);
        let ranked = coverage.ranked(&ids, 10.0);
        let expected = [(ids[2], 0.4), (ids[0], 0.2), (ids[1], 0.1)];
        for (pair, (id, share)) in ranked.chunks(2).zip(expected) {
            assert_eq!((pair[0].to_bits(), pair[1]), (id, share));
        }
        assert_eq!(ranked[6..], [0.0; 6]);
    }
}
