//! A view transform as a table, so that a page can show light without knowing any formula: what is added to
//! [`View`] shows up there by itself.
//!
//! A place in the table is a colour whose channels went through s(x) = log2(1 + 63 x)/10.5, which is 1 at x = 23: what is
//! brighter is shown as that is. Light 1, where most views have an edge, is at s = 4/7, a point of the table. Between points it is read by
//! tetrahedra, whose faces lie where the largest or the least channel changes, at which views have edges too: greys then
//! depend on greys alone.

use crate::math::parallel;
use crate::output::View;
use crate::output::view::on_screen;
use half::f16;

/// The views that the page offers: those that a table can show. False colours have edges, and the page has its own.
pub fn on_page() -> impl Iterator<Item = View> {
    View::ALL.into_iter().filter(|view| *view != View::FalseColor)
}

/// Points of the table along each channel.
pub const SIZE: usize = 64;
/// What light is multiplied by before the logarithm.
const GAIN: f64 = 63.0;
/// Doublings from nothing to the brightest light, after 1 was added to it.
const DOUBLINGS: f64 = 10.5;

/// Light at point `i` of a channel.
fn light(i: usize) -> f32 {
    (((DOUBLINGS * i as f64 / (SIZE - 1) as f64).exp2() - 1.0) / GAIN) as f32
}

/// What the screen shows at each point, red fastest, as red, green, blue and 1 in half precision, little-endian.
pub fn table(view: View) -> Vec<u8> {
    let layers = parallel::map(SIZE, |b| {
        let points = (0..SIZE * SIZE).map(|i| [light(i % SIZE), light(i / SIZE), light(b)]);
        let shown = points.flat_map(|point| {
            let [r, g, b] = on_screen(view, point);
            [r, g, b, 1.0].map(|x| f16::from_f32(x).to_le_bytes())
        });
        shown.flatten().collect::<Vec<u8>>()
    });
    layers.concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};

    /// As the page does it.
    fn look_up(table: &[u8], rgb: [f32; 3]) -> [f32; 3] {
        let at = rgb.map(|x| (1.0 + GAIN * f64::from(x)).log2().min(DOUBLINGS) / DOUBLINGS * (SIZE - 1) as f64);
        let low = at.map(|x| (x as usize).min(SIZE - 2));
        let part: [f64; 3] = std::array::from_fn(|axis| at[axis] - low[axis] as f64);
        let mut axes = [0, 1, 2];
        axes.sort_by(|a, b| part[*b].total_cmp(&part[*a]));
        let (mut place, mut shown) = (low, [0.0f64; 3]);
        let mut add = |place: [usize; 3], weight: f64| {
            let start = 8 * ((place[2] * SIZE + place[1]) * SIZE + place[0]);
            for (channel, shown) in shown.iter_mut().enumerate() {
                let bytes = [table[start + 2 * channel], table[start + 2 * channel + 1]];
                *shown += weight * f16::from_le_bytes(bytes).to_f64();
            }
        };
        add(place, 1.0 - part[axes[0]]);
        for (n, axis) in axes.into_iter().enumerate() {
            place[axis] += 1;
            add(place, part[axis] - axes.get(n + 1).map_or(0.0, |next| part[*next]));
        }
        shown.map(|x| x as f32)
    }

    #[test]
    fn what_the_table_shows_is_what_the_view_shows() {
        for view in on_page() {
            let table = table(view);
            assert_eq!(table.len(), SIZE.pow(3) * 8);
            let mut rng = CounterRng::new(Seed(1));
            let (mut worst, mut sum) = (0.0f32, 0.0f64);
            let count = 50_000;
            for i in 0..count {
                // Greys, and colours from deep shadow to beyond white.
                let scale = (rng.uniform() * 14.5 - 10.0).exp2();
                let mut channel = || if i % 4 == 0 { scale } else { scale * rng.uniform() };
                let rgb = [channel(), channel(), channel()];
                let (shown, table) = (on_screen(view, rgb), look_up(&table, rgb));
                for (a, b) in shown.iter().zip(table) {
                    worst = worst.max((a - b).abs());
                    sum += f64::from((a - b).abs());
                }
            }
            let mean = 255.0 * sum / (3.0 * f64::from(count));
            println!("{}: worst {:.2}, mean {mean:.3} of 255", view.name(), 255.0 * worst);
            // Where hues of AgX turn over, the table is coarse.
            let most = if view == View::Agx { 6.0 } else { 2.0 };
            assert!(255.0 * worst < most && mean < 0.1, "{}: {} and {mean} of 255", view.name(), 255.0 * worst);
        }
    }
}
