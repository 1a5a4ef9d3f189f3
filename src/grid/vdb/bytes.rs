//! A place in the bytes of a file, from which numbers and texts are read with every length checked.

use crate::grid::vdb::VdbProblem;

/// Longest name or type name believed; real ones have tens of characters.
const MAX_TEXT: usize = 1 << 16;

#[derive(Clone)]
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    offset: usize,
}

macro_rules! number {
    ($name:ident, $t:ty) => {
        pub(super) fn $name(&mut self, what: &str) -> Result<$t, VdbProblem> {
            Ok(<$t>::from_le_bytes(self.array(what)?))
        }
    };
}

impl<'a> Cursor<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, offset: 0 }
    }

    pub(super) fn offset(&self) -> usize {
        self.offset
    }

    /// The same bytes from `offset` on, which must be inside the file.
    pub(super) fn seek(&mut self, offset: i64, what: &str) -> Result<(), VdbProblem> {
        match usize::try_from(offset) {
            Ok(o) if o <= self.bytes.len() => self.offset = o,
            _ => {
                return Err(
                    self.malformed(format!("{what} is at byte {offset}, the file has {} bytes", self.bytes.len()))
                );
            }
        }
        Ok(())
    }

    pub(super) fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], VdbProblem> {
        let rest = self.bytes.get(self.offset..).unwrap_or_default();
        let Some(taken) = rest.get(..count) else {
            return Err(
                self.malformed(format!("the file ends within {what}: {count} bytes expected, {} left", rest.len()))
            );
        };
        self.offset += count;
        Ok(taken)
    }

    pub(super) fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], VdbProblem> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, what)?);
        Ok(array)
    }

    number!(u8, u8);
    number!(u32, u32);
    number!(i32, i32);
    number!(i64, i64);
    number!(u64, u64);
    number!(f32, f32);
    number!(f64, f64);

    pub(super) fn text(&mut self, what: &str) -> Result<String, VdbProblem> {
        let length = self.u32(what)? as usize;
        if length > MAX_TEXT {
            return Err(self.malformed(format!("{what} claims a length of {length} bytes")));
        }
        Ok(String::from_utf8_lossy(self.take(length, what)?).into_owned())
    }

    pub(super) fn malformed(&self, what: impl Into<String>) -> VdbProblem {
        VdbProblem::Malformed { offset: self.offset, what: what.into() }
    }

    pub(super) fn unsupported(&self, what: impl Into<String>) -> VdbProblem {
        VdbProblem::Unsupported { offset: self.offset, what: what.into() }
    }
}
