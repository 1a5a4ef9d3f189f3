//! The same work for many things at once, on all threads of the current pool.
//!
//! All of the crate goes through here, and here everything goes through [`for_each_index`]: the machinery that shares
//! work out is some thousand lines to compile for each type it is used with, so it knows indices and calls of one kind
//! alone. What is called so is a whole piece of the work; inside a piece is a plain loop.
//!
//! Results stand in the order of indices, and no result depends on the number of threads.

use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Pieces of work for each thread: enough that none waits long for the last one, few enough that a piece costs nothing.
const PIECES_A_THREAD: usize = 32;

/// Threads of the current pool.
pub fn thread_count() -> usize {
    rayon::current_num_threads()
}

/// Calls `work` with each index below `count`, each on its own: for work of some microseconds or more.
pub fn for_each_index(count: usize, work: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().with_max_len(1).for_each(work);
}

/// Both at once.
pub fn join(a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)) {
    rayon::join(a, b);
}

/// Sorts.
pub fn sort(values: &mut [u64]) {
    values.par_sort_unstable();
}

/// Calls `work` with the number of each item and the item, each on its own as in [`for_each_index`]. Items may be parts
/// of arrays to write to.
pub fn for_each<I: Send>(items: impl IntoIterator<Item = I>, work: impl Fn(usize, I) + Sync) {
    let items: Vec<Mutex<Option<I>>> = items.into_iter().map(|item| Mutex::new(Some(item))).collect();
    for_each_index(items.len(), &|i| {
        let item = locked(&items[i]).take();
        item.into_iter().for_each(|item| work(i, item));
    });
}

/// What `work` makes of each item, or the error of the first item that has one; later items are left out then. Each is
/// done on its own, as in [`for_each`].
///
/// # Errors
/// Those of `work`.
pub fn try_map<I: Send, T: Send, E: Send>(
    items: impl IntoIterator<Item = I>,
    work: impl Fn(usize, I) -> Result<T, E> + Sync,
) -> Result<Vec<T>, E> {
    let items: Vec<I> = items.into_iter().collect();
    let mut results: Vec<Option<Result<T, E>>> = items.iter().map(|_| None).collect();
    let failed = AtomicUsize::new(usize::MAX);
    for_each(items.into_iter().zip(&mut results), |i, (item, result)| {
        // Those before it may have an error that comes first.
        if i < failed.load(Ordering::Relaxed) {
            let made = work(i, item);
            if made.is_err() {
                failed.fetch_min(i, Ordering::Relaxed);
            }
            *result = Some(made);
        }
    });
    results.into_iter().flatten().collect()
}

/// What `value` gives for each index below `count`.
pub fn map<T: Send>(count: usize, value: impl Fn(usize) -> T + Sync) -> Vec<T> {
    gather_pieces(count, &|piece, values| values.extend(piece.map(&value)))
}

/// All that `visit` adds to the list for each index below `count`, in their order.
pub fn gather<T: Send>(count: usize, visit: impl Fn(usize, &mut Vec<T>) + Sync) -> Vec<T> {
    gather_pieces(count, &|piece, values| piece.for_each(|i| visit(i, values)))
}

/// What `look` finds at the first index below `count` where it finds anything.
pub fn find_first<T: Send>(count: usize, look: impl Fn(usize) -> Option<T> + Sync) -> Option<T> {
    let first = AtomicUsize::new(usize::MAX);
    let found = gather_pieces(count, &|mut piece, found| {
        if piece.start < first.load(Ordering::Relaxed) {
            found.extend(piece.find_map(|i| {
                let here = look(i)?;
                first.fetch_min(i, Ordering::Relaxed);
                Some(here)
            }));
        }
    });
    found.into_iter().next()
}

/// The values at indices below `count`, of those that have any, made one by `join`. Which are joined first depends on
/// the number of threads: whole numbers and largest values come out equal, sums of real numbers do not.
pub fn reduce<T: Send>(
    count: usize,
    value: impl Fn(usize) -> Option<T> + Sync,
    join: impl Fn(T, T) -> T + Sync,
) -> Option<T> {
    let parts = gather_pieces(count, &|piece, parts| parts.extend(piece.filter_map(&value).reduce(&join)));
    parts.into_iter().reduce(join)
}

/// Sum of the whole numbers at indices below `count`.
pub fn sum(count: usize, value: impl Fn(usize) -> u64 + Sync) -> u64 {
    gather_pieces(count, &|piece, sums| sums.push(piece.map(&value).sum::<u64>())).into_iter().sum()
}

/// Calls `work` with the index of each value and the value. Large arrays are better made so than by [`map`], which
/// holds them twice for a moment.
pub fn for_each_mut<T: Send>(values: &mut [T], work: impl Fn(usize, &mut T) + Sync) {
    for_each_piece_mut(values, 1, &|start, piece| piece.iter_mut().enumerate().for_each(|(i, v)| work(start + i, v)));
}

/// Calls `work` with the number of each chunk of `size` values and the chunk; the last may be shorter.
///
/// # Panics
/// Where `size` is 0.
pub fn for_each_chunk_mut<T: Send>(values: &mut [T], size: usize, work: impl Fn(usize, &mut [T]) + Sync) {
    for_each_piece_mut(values, size, &|start, piece| {
        piece.chunks_mut(size).enumerate().for_each(|(i, chunk)| work(start / size + i, chunk));
    });
}

/// Calls `work` with pieces of the values, which begin at multiples of `size`, and the index of their first value.
fn for_each_piece_mut<T: Send>(values: &mut [T], size: usize, work: &(dyn Fn(usize, &mut [T]) + Sync)) {
    let length = piece_length(values.len().div_ceil(size)) * size;
    let pieces: Vec<Mutex<&mut [T]>> = values.chunks_mut(length).map(Mutex::new).collect();
    for_each_index(pieces.len(), &|n| work(n * length, &mut locked(&pieces[n])));
}

/// All that `visit` adds to the list for pieces of `0 .. count`, in their order.
fn gather_pieces<T: Send>(count: usize, visit: &(dyn Fn(Range<usize>, &mut Vec<T>) + Sync)) -> Vec<T> {
    let length = piece_length(count);
    let pieces: Vec<Mutex<Vec<T>>> = (0..count.div_ceil(length)).map(|_| Mutex::default()).collect();
    for_each_index(pieces.len(), &|n| {
        // Lists grow where no other thread writes beside them.
        let mut piece = Vec::new();
        visit(n * length..count.min((n + 1) * length), &mut piece);
        *locked(&pieces[n]) = piece;
    });
    let pieces: Vec<Vec<T>> =
        pieces.into_iter().map(|p| p.into_inner().unwrap_or_else(PoisonError::into_inner)).collect();
    let mut all = Vec::with_capacity(pieces.iter().map(Vec::len).sum());
    for mut piece in pieces {
        all.append(&mut piece);
    }
    all
}

/// Indices of a piece.
fn piece_length(count: usize) -> usize {
    count.div_ceil(PIECES_A_THREAD * thread_count()).max(1)
}

fn locked<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In pools of several sizes.
    fn everywhere(work: impl Fn() + Sync + Send) {
        for threads in [1, 2, 7] {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(&work);
        }
    }

    #[test]
    fn results_stand_in_the_order_of_indices() {
        everywhere(|| {
            for count in [0, 1, 2, 31, 1000, 4711] {
                assert!(map(count, |i| i).into_iter().eq(0..count));
                let twice = gather(count, |i, list| list.extend((0..i % 3).map(|_| i)));
                assert!(twice.into_iter().eq((0..count).flat_map(|i| (0..i % 3).map(move |_| i))));
                let sum_of_all = sum(count, |i| i as u64);
                assert_eq!(sum_of_all, (0..count as u64).sum::<u64>());
                assert_eq!(reduce(count, |i| (i % 7 == 3).then_some(i), usize::max), (0..count).rfind(|i| i % 7 == 3));
            }
        });
    }

    #[test]
    fn values_and_chunks_come_with_their_numbers() {
        everywhere(|| {
            let mut values = vec![0; 4711];
            for_each_mut(&mut values, |i, v| *v += i);
            assert!(values.iter().copied().eq(0..4711));
            for size in [1, 3, 100, 5000] {
                for_each_chunk_mut(&mut values, size, |n, chunk| {
                    assert!(chunk.iter().copied().eq(n * size..(n * size + size).min(4711)));
                });
            }
            for_each(values.chunks_mut(10), |n, chunk| chunk.fill(n));
            assert!(values.iter().enumerate().all(|(i, v)| *v == i / 10));
            for_each_chunk_mut(&mut [0; 0], 3, |_, _| unreachable!());
        });
    }

    #[test]
    fn the_first_in_order_wins() {
        everywhere(|| {
            for firsts in [vec![], vec![4710], vec![1203, 12, 3000], vec![0]] {
                let expected = firsts.iter().min().copied();
                assert_eq!(find_first(4711, |i| firsts.contains(&i).then_some(i)), expected);
                let tried = try_map(0..4711, |i, item| if firsts.contains(&i) { Err(i) } else { Ok(item) });
                assert_eq!(tried.as_ref().err().copied(), expected);
                assert!(tried.is_err() || tried.unwrap().into_iter().eq(0..4711));
            }
        });
    }
}
