//! How much memory a scene will need at least, known before any of it is allocated.

use crate::settings::{Advect, Emitter, Frames, Settings};

/// Memory of a particle that is held [bytes]: 32 on its way (8 more along tracks) and 44 at the frame, in arrays that grow and so
/// may be half empty.
const PARTICLE_BYTES: f64 = 128.0;
/// The same for how its way bends while a shutter is open [bytes]: 24 of the particle, and 60 while they are found.
const BEND_BYTES: f64 = 84.0;
/// Memory of a pixel without further layers when it is most [bytes]: 28 in tiles and as much again where they are put
/// together.
const PIXEL_BYTES: f64 = 64.0;

/// Memory of a number of a further layer when it is most [bytes]: in a channel of the picture, as it is stored, and in a file
/// that does not compress.
const LAYER_BYTES: f64 = 12.0;

/// Memory of the picture with its layers [bytes].
pub fn film_bytes(settings: &Settings) -> f64 {
    let groups = settings.light_groups().len();
    let channels: usize = settings.output.aovs.iter().map(|aov| aov.channel_count(groups)).sum();
    let pixels: f64 = settings.film.size().map(f64::from).iter().product();
    // Sums of all pixels wait for the next pass.
    let sums = if settings.film.time_limit.is_some() { sum_bytes(channels) } else { 0.0 };
    pixels * (PIXEL_BYTES + LAYER_BYTES * channels as f64 + sums)
}

/// Memory of a particle that is held [bytes].
pub fn particle_bytes(frames: &Frames) -> f64 {
    PARTICLE_BYTES + if frames.shutter != [0.0; 2] { BEND_BYTES } else { 0.0 }
}

/// Memory of what the paths of all pixels add up to, where that is kept [bytes].
pub fn sums_bytes(settings: &Settings) -> f64 {
    let groups = settings.light_groups().len();
    let channels: usize = settings.output.aovs.iter().map(|aov| aov.channel_count(groups)).sum();
    settings.film.size().map(f64::from).iter().product::<f64>() * sum_bytes(channels)
}

/// The same of a pixel: exact sums as they are written, and the shapes that it has met.
fn sum_bytes(channels: usize) -> f64 {
    4.0 * PIXEL_BYTES + 24.0 * channels as f64
}

/// Most particles that are held at once, of `count` that are alive.
pub fn held_count(count: f64, advect: &Advect) -> f64 {
    advect.batch.map_or(count, |batch| count.min(batch as f64))
}

/// Most particles of an emitter that can be alive at once in the frames of the scene: an upper bound.
pub fn live_count(emitter: &Emitter, frames: &Frames) -> f64 {
    let end =
        f64::from(frames.last.saturating_sub(frames.first)) / frames.fps + frames.shutter[1].max(0.0) / frames.fps;
    let oldest = emitter.lifetime * (1.0 + emitter.lifetime_spread);
    let last_birth = emitter.stop.unwrap_or(f64::INFINITY).min(end);
    // Alive in some frame: born before the end, and not dead before the first frame.
    let first_birth = emitter.start.max(frames.shutter[0].min(0.0) / frames.fps - oldest);
    let span = (last_birth - first_birth).max(0.0);
    match (emitter.rate, emitter.count) {
        // Those that die within a step live to its end, and a step is at most a frame.
        (Some(rate), _) => rate * span.min(oldest + 1.0 / frames.fps),
        (None, Some(count)) if emitter.start <= end && emitter.start + oldest >= 0.0 => count as f64,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn emitter(text: &str) -> Emitter {
        serde_yaml::from_str(text).unwrap()
    }

    #[test]
    fn particles_alive_at_once() {
        let frames = Frames { first: 1, last: 25, fps: 24.0, shutter: [0.0, 0.0] };
        let count = |text: &str| live_count(&emitter(text), &frames);
        assert_eq!(count("{rate: 96, lifetime: 0.5, lifetime_spread: 0}"), 52.0);
        assert_eq!(count("{rate: 100, lifetime: 10, lifetime_spread: 0}"), 100.0);
        assert_eq!(count("{rate: 96, lifetime: 10, lifetime_spread: 0, start: -20}"), 964.0);
        assert_eq!(count("{rate: 100, lifetime: 10, stop: 0.25}"), 25.0);
        assert_eq!(count("{count: 7, lifetime: 1}"), 7.0);
        assert_eq!(count("{count: 7, lifetime: 1, start: 5}"), 0.0);
        assert_eq!(count("{count: 7, lifetime: 1, start: -5}"), 0.0);
        assert_eq!(count("{rate: 100, lifetime: 1, start: -50, stop: -40}"), 0.0);
    }
}
