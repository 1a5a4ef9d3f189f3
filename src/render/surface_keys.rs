//! How a flow along a surface goes on in time, where that is given by keys.

use crate::math::interpolate::cubic_step;

/// How far a flow has gone, and how it is followed there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlowState {
    /// How far things have been carried [m].
    pub distance: f64,
    /// Size of the swirls [m], > 0.
    pub length: f64,
    /// Steps that the way is cut into; whoever follows it chooses where `None`.
    pub steps: Option<f64>,
}

/// The state of a flow at a time [s], between keys of rising times; before the first and after the last it stands still.
/// `is_smooth` comes to rest at each key, instead of going from key to key at constant speed. `None` without keys.
pub fn state_at(keys: &[(f64, FlowState)], time: f64, is_smooth: bool) -> Option<FlowState> {
    let next = keys.partition_point(|key| key.0 <= time);
    if next == 0 || next == keys.len() {
        return keys.get(next.saturating_sub(1)).map(|key| key.1);
    }
    let ((start, a), (end, b)) = (keys[next - 1], keys[next]);
    let t = (time - start) / (end - start);
    let t = if is_smooth { cubic_step(t) } else { t };
    let between = |a: f64, b: f64| a * (1.0 - t) + b * t;
    Some(FlowState {
        distance: between(a.distance, b.distance),
        length: between(a.length, b.length),
        steps: a.steps.zip(b.steps).map(|(a, b)| between(a, b)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(time: f64, distance: f64, length: f64, steps: Option<f64>) -> (f64, FlowState) {
        (time, FlowState { distance, length, steps })
    }

    #[test]
    fn keys_are_met_and_nothing_moves_beyond_them() {
        let keys = [key(1.0, 0.0, 0.5, Some(16.0)), key(2.0, 1.0, 0.3, Some(64.0)), key(4.0, -1.0, 0.3, None)];
        for is_smooth in [true, false] {
            let at = |time| state_at(&keys, time, is_smooth).expect("there are keys");
            for (time, state) in
                [(-3.0, keys[0].1), (1.0, keys[0].1), (2.0, keys[1].1), (4.0, keys[2].1), (9.0, keys[2].1)]
            {
                assert_eq!(at(time).distance, state.distance);
                assert_eq!(at(time).length, state.length);
            }
            assert_eq!(at(1.5), FlowState { distance: 0.5, length: 0.4, steps: Some(40.0) });
            assert_eq!((at(3.0).distance, at(3.0).steps), (0.0, None));
        }
        assert!(state_at(&keys, 1.01, true).unwrap().distance < 0.1 * state_at(&keys, 1.01, false).unwrap().distance);
        assert_eq!(state_at(&[], 0.0, true), None);
    }
}
