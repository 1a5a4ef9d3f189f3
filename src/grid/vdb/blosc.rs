//! Blosc 1 containers: blocks of one buffer, byte-shuffled and each compressed by one of several codecs.
//!
//! The format is described in `README_HEADER.rst` of c-blosc. Codecs LZ4 (what OpenVDB writes) and zlib are read.

use std::io::Read;

const HEADER: usize = 16;
const BYTE_SHUFFLE: u8 = 0x1;
const STORED: u8 = 0x2;
const BIT_SHUFFLE: u8 = 0x4;
const NOT_SPLIT: u8 = 0x10;
/// Blocks are split into one stream for each byte of an element where elements have at most this many bytes …
const MAX_SPLITS: usize = 16;
/// … and each stream at least this many.
const MIN_STREAM: usize = 128;

/// Fills `out` from the container `bytes`; a sentence on what is wrong otherwise. Reads nothing outside `bytes` and
/// allocates no more than the size of `out`.
pub(super) fn decompress(bytes: &[u8], out: &mut [u8]) -> Result<(), String> {
    let &[_, _, flags, type_size, ..] = bytes else { return Err("the Blosc header is cut off".into()) };
    let size = word(bytes, 4)?;
    let block_size = word(bytes, 8)?;
    if size != out.len() {
        return Err(format!("a Blosc buffer of {size} bytes where {} are needed", out.len()));
    }
    if bytes.len() < HEADER {
        return Err("the Blosc header is cut off".into());
    }
    if flags & STORED != 0 {
        let stored = bytes.get(HEADER..HEADER + size).ok_or("a stored Blosc buffer is cut off")?;
        out.copy_from_slice(stored);
        return Ok(());
    }
    if flags & BIT_SHUFFLE != 0 {
        return Err("Blosc with bit shuffle is not read; re-save without Blosc".into());
    }
    if size > 0 && block_size == 0 {
        return Err("a Blosc block size of 0".into());
    }
    let type_size = usize::from(type_size).max(1);
    let mut plain = vec![0; block_size.min(size)];
    for (idx, out) in out.chunks_mut(block_size.max(1)).enumerate() {
        let is_whole = out.len() == block_size;
        let is_split =
            flags & NOT_SPLIT == 0 && type_size <= MAX_SPLITS && block_size / type_size >= MIN_STREAM && is_whole;
        let plain = &mut plain[..out.len()];
        decompress_block(
            bytes,
            word(bytes, HEADER + 4 * idx)?,
            flags >> 5,
            plain,
            if is_split { type_size } else { 1 },
        )?;
        if flags & BYTE_SHUFFLE != 0 && type_size > 1 {
            unshuffle(plain, out, type_size);
        } else {
            out.copy_from_slice(plain);
        }
    }
    Ok(())
}

fn word(bytes: &[u8], at: usize) -> Result<usize, String> {
    match bytes.get(at..).and_then(|b| b.first_chunk::<4>()) {
        Some(b) => Ok(u32::from_le_bytes(*b) as usize),
        None => Err("a Blosc buffer is cut off".into()),
    }
}

fn decompress_block(bytes: &[u8], start: usize, codec: u8, plain: &mut [u8], streams: usize) -> Result<(), String> {
    let mut at = start;
    let stream_size = plain.len() / streams;
    if stream_size * streams != plain.len() {
        return Err("a Blosc block does not divide into its streams".into());
    }
    for stream in plain.chunks_mut(stream_size.max(1)) {
        let length = word(bytes, at)?;
        let packed = bytes.get(at + 4..).and_then(|b| b.get(..length)).ok_or("a Blosc block is cut off")?;
        at += 4 + length;
        if length == stream.len() {
            stream.copy_from_slice(packed);
        } else {
            decompress_stream(codec, packed, stream)?;
        }
    }
    Ok(())
}

fn decompress_stream(codec: u8, packed: &[u8], stream: &mut [u8]) -> Result<(), String> {
    let length = match codec {
        1 => lz4_flex::block::decompress_into(packed, stream).map_err(|e| format!("a broken LZ4 block: {e}"))?,
        3 => {
            let mut decoder = flate2::read::ZlibDecoder::new(packed);
            decoder.read_exact(stream).map_err(|e| format!("a broken zlib block: {e}"))?;
            stream.len()
        }
        _ => {
            let name = ["BloscLZ", "LZ4", "Snappy", "zlib", "Zstandard"].get(usize::from(codec)).unwrap_or(&"unknown");
            return Err(format!("Blosc's codec {name} is not read; re-save without Blosc"));
        }
    };
    if length != stream.len() {
        return Err(format!("an LZ4 block of {length} bytes where {} are needed", stream.len()));
    }
    Ok(())
}

/// Byte `b` of element `e` lies at `b·elements + e`; what does not fill an element stays at the end.
fn unshuffle(from: &[u8], to: &mut [u8], type_size: usize) {
    let elements = from.len() / type_size;
    let (shuffled, rest) = from.split_at(elements * type_size);
    let (whole, end) = to.split_at_mut(elements * type_size);
    end.copy_from_slice(rest);
    for (element, out) in whole.chunks_exact_mut(type_size).enumerate() {
        for (byte, out) in out.iter_mut().enumerate() {
            *out = shuffled[byte * elements + element];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shuffled(values: &[u8], type_size: usize) -> Vec<u8> {
        let elements = values.len() / type_size;
        let mut out: Vec<u8> =
            (0..type_size).flat_map(|b| (0..elements).map(move |e| values[e * type_size + b])).collect();
        out.extend(&values[elements * type_size..]);
        out
    }

    /// A container with one LZ4 stream for each block.
    fn pack(values: &[u8], block_size: usize) -> Vec<u8> {
        let blocks: Vec<Vec<u8>> =
            values.chunks(block_size).map(|b| lz4_flex::block::compress(&shuffled(b, 4))).collect();
        let mut bytes = vec![2, 1, BYTE_SHUFFLE | NOT_SPLIT | 1 << 5, 4];
        let mut at = HEADER + 4 * blocks.len();
        let total = at + blocks.iter().map(|b| b.len() + 4).sum::<usize>();
        for n in [values.len(), block_size, total] {
            bytes.extend((n as u32).to_le_bytes());
        }
        for b in &blocks {
            bytes.extend((at as u32).to_le_bytes());
            at += b.len() + 4;
        }
        for b in &blocks {
            bytes.extend((b.len() as u32).to_le_bytes());
            bytes.extend(b);
        }
        bytes
    }

    #[test]
    fn blocks_come_back_as_they_were() {
        let values: Vec<u8> = (0..2500u32).flat_map(|i| ((i as f32).sqrt()).to_le_bytes()).collect();
        for block_size in [10_000, 4096, 1000] {
            let mut out = vec![0; values.len()];
            decompress(&pack(&values, block_size), &mut out).unwrap();
            assert_eq!(out, values);
        }
    }

    #[test]
    fn every_truncation_and_every_changed_byte_is_survived() {
        let values: Vec<u8> = (0..600u32).flat_map(|i| (i / 7).to_le_bytes()).collect();
        let packed = pack(&values, 1024);
        let mut out = vec![0; values.len()];
        for end in 0..packed.len() {
            assert!(decompress(&packed[..end], &mut out).is_err(), "{end}");
        }
        for at in 0..packed.len() {
            for change in [0x01, 0x80, 0xff] {
                let mut bytes = packed.clone();
                bytes[at] ^= change;
                let _ = decompress(&bytes, &mut out);
            }
        }
    }
}
