//! How a flow along a surface goes on in time, where that is given by keys.

use crate::math::keys::Between;

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

impl Between for FlowState {
    fn between(&self, to: &Self, share: f64) -> Self {
        Self {
            distance: self.distance.between(&to.distance, share),
            length: self.length.between(&to.length, share),
            steps: self.steps.zip(to.steps).map(|(a, b)| a.between(&b, share)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_blend_where_both_keys_have_them() {
        let state = |distance, length, steps| FlowState { distance, length, steps };
        let (a, b, c) = (state(0.0, 0.5, Some(16.0)), state(1.0, 0.3, Some(64.0)), state(-1.0, 0.3, None));
        assert_eq!(a.between(&b, 0.5), state(0.5, 0.4, Some(40.0)));
        assert_eq!(b.between(&c, 0.5), state(0.0, 0.3, None));
    }
}
