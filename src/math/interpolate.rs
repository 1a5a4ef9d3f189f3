//! Smooth steps with their derivatives, and interpolation weights.
