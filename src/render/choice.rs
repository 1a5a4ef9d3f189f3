//! Which light is asked for a direct connection.
//!
//! Lights infinitely far are weighed once, by the square root of their irradiance. Lights that have a place are weighed at
//! every lit point, by their irradiance there without what is in the way; all of them together weigh the square root of
//! their sum against the far ones. Many of them come in groups of neighbours, of which one is chosen first, so that the
//! work grows with the square root of their number: the light tree of Conty Estévez and Kulla 2018, *Importance Sampling of
//! Many Lights with Adaptive Tree Splitting*, with two levels.

use crate::math::aabb::Aabb;
use crate::math::space::WorldPoint;
use crate::render::light::Light;
use glam::Vec3;

/// Lights with a place that are all weighed at every point; more are grouped.
const WEIGHED_ALL: usize = 32;

/// How lights are chosen.
#[derive(Debug)]
pub struct LightChoice {
    /// Running sums of the probability of each light without a place. All there is where no light has one.
    far: Vec<f32>,
    /// The light to ask where there is but one.
    only: Option<usize>,
    near: Option<Near>,
}

/// Lights with a place, and what they compete with.
#[derive(Debug)]
struct Near {
    groups: Vec<Group>,
    /// Group of each light, for those with a place.
    group_of: Vec<Option<u32>>,
    /// Shares of the far lights: index and running sum.
    far: Vec<(usize, f32)>,
    far_total: f32,
}

/// Neighbours.
#[derive(Debug)]
struct Group {
    lights: Vec<u32>,
    center: WorldPoint,
    radius_sq: f32,
    /// Sum of the largest intensities [W/sr], as luminance.
    intensity: f32,
}

impl LightChoice {
    /// Weighs `lights`.
    pub fn new(lights: &[Light]) -> Self {
        let is_near = |light: &Light| light.place().is_some() && light.is_worth_sampling();
        let share = |light: &Light| if light.is_worth_sampling() { light.far_irradiance().sqrt() } else { 0.0 };
        let shares: Vec<f32> = lights.iter().map(share).collect();
        let total: f32 = shares.iter().sum();
        let mut sum = 0.0;
        let running = |share: &f32| {
            sum += if total > 0.0 { share / total } else { 0.0 };
            sum
        };
        let far = shares.iter().map(running).collect();
        let is_asked = |&i: &usize| shares[i] > 0.0 || lights[i].peak_intensity() > 0.0;
        let asked: Vec<usize> = (0..lights.len()).filter(is_asked).collect();
        let near = (asked.len() > 1 && lights.iter().any(is_near)).then(|| Near::new(lights, &shares, is_near));
        let only = if let [only] = asked[..] { Some(only) } else { None };
        Self { far, only, near }
    }

    /// The light that is chosen whatever the point and the number, where there is but one to choose.
    pub fn only(&self) -> Option<usize> {
        self.only
    }

    /// The light chosen at a lit point by the uniform number `u`, and the probability of that.
    #[inline]
    pub fn choose(&self, lights: &[Light], at: WorldPoint, u: f32) -> Option<(usize, f32)> {
        if let Some(i) = self.only {
            return Some((i, 1.0));
        }
        if let Some(near) = &self.near {
            return near.choose(lights, at, u);
        }
        self.choose_far(u)
    }

    fn choose_far(&self, u: f32) -> Option<(usize, f32)> {
        let last = *self.far.last()?;
        if last <= 0.0 {
            return None;
        }
        let i = self.far.partition_point(|&c| c <= u * last).min(self.far.len() - 1);
        Some((i, self.far_pmf(i)))
    }

    /// Probability of choosing light `i` at a lit point.
    #[inline]
    pub fn pmf(&self, lights: &[Light], at: WorldPoint, i: usize) -> f32 {
        if let Some(only) = self.only {
            return if i == only { 1.0 } else { 0.0 };
        }
        self.near.as_ref().map_or_else(|| self.far_pmf(i), |near| near.pmf(lights, at, i))
    }

    #[inline]
    fn far_pmf(&self, i: usize) -> f32 {
        self.far[i] - if i == 0 { 0.0 } else { self.far[i - 1] }
    }
}

impl Near {
    fn new(lights: &[Light], shares: &[f32], is_near: impl Fn(&Light) -> bool) -> Self {
        let mut near: Vec<u32> = (0..lights.len() as u32).filter(|&i| is_near(&lights[i as usize])).collect();
        let size = if near.len() <= WEIGHED_ALL { near.len() } else { (near.len() as f32).sqrt().ceil() as usize };
        let mut groups = Vec::new();
        halve(&mut near, lights, size, &mut groups);
        let mut group_of = vec![None; lights.len()];
        for (g, group) in groups.iter().enumerate() {
            group.lights.iter().for_each(|&i| group_of[i as usize] = Some(g as u32));
        }
        let mut far_total = 0.0;
        let far = (0..lights.len()).filter(|&i| shares[i] > 0.0 && group_of[i].is_none());
        let far = far.map(|i| {
            far_total += shares[i];
            (i, far_total)
        });
        let far = far.collect();
        Self { groups, group_of, far, far_total }
    }

    /// Weight of all lights with a place at a point, by the rough irradiance of their groups.
    fn irradiance(&self, lights: &[Light], at: WorldPoint) -> f32 {
        match &self.groups[..] {
            [only] => only.exact(lights, at),
            groups => groups.iter().map(|group| group.rough(at)).sum(),
        }
    }

    fn choose(&self, lights: &[Light], at: WorldPoint, u: f32) -> Option<(usize, f32)> {
        let irradiance = self.irradiance(lights, at);
        let share = irradiance.sqrt();
        let total = self.far_total + share;
        let target = u * total;
        if total <= 0.0 {
            return None;
        }
        if target < self.far_total || share <= 0.0 {
            let k = self.far.partition_point(|&(_, sum)| sum <= target).min(self.far.len() - 1);
            let before = if k == 0 { 0.0 } else { self.far[k - 1].1 };
            return Some((self.far[k].0, (self.far[k].1 - before) / total));
        }
        let mut left = (target - self.far_total) / share * irradiance;
        let [only] = &self.groups[..] else {
            let (group, weight) = pick(self.groups.iter().map(|group| group.rough(at)), &mut left)?;
            let exact = self.groups[group].exact(lights, at);
            left *= exact / weight;
            let (i, own) = self.groups[group].pick(lights, at, &mut left)?;
            return Some((i, own / exact * weight / irradiance * share / total));
        };
        let (i, own) = only.pick(lights, at, &mut left)?;
        Some((i, own / irradiance * share / total))
    }

    #[inline]
    fn pmf(&self, lights: &[Light], at: WorldPoint, i: usize) -> f32 {
        let irradiance = self.irradiance(lights, at);
        let share = irradiance.sqrt();
        let total = self.far_total + share;
        if total <= 0.0 {
            return 0.0;
        }
        let Some(group) = self.group_of[i] else {
            let k = self.far.iter().position(|&(far, _)| far == i);
            let of = |k: usize| self.far[k].1 - if k == 0 { 0.0 } else { self.far[k - 1].1 };
            return k.map_or(0.0, |k| of(k) / total);
        };
        let group = &self.groups[group as usize];
        let own = lights[i].irradiance_at(at);
        if own <= 0.0 {
            return 0.0;
        }
        let of_group = if self.groups.len() == 1 { 1.0 } else { group.rough(at) / group.exact(lights, at) };
        own * of_group / irradiance * share / total
    }
}

impl Group {
    fn new(members: &[u32], lights: &[Light]) -> Self {
        let places = || members.iter().filter_map(|&i| lights[i as usize].place());
        let center = WorldPoint(Aabb::from_points(places().map(|(p, _)| p.0)).center());
        let radius = places().map(|(p, radius)| (p - center).length() + radius).fold(0.0, f32::max);
        let intensity = members.iter().map(|&i| lights[i as usize].peak_intensity()).sum();
        Self { lights: members.to_vec(), center, radius_sq: (radius * radius).max(1e-4), intensity }
    }

    /// Irradiance at a point as if all were in the middle, or at the rim from inside.
    fn rough(&self, at: WorldPoint) -> f32 {
        self.intensity / (at - self.center).length_squared().max(self.radius_sq)
    }

    /// Sum over its lights.
    fn exact(&self, lights: &[Light], at: WorldPoint) -> f32 {
        self.lights.iter().map(|&i| lights[i as usize].irradiance_at(at)).sum()
    }

    fn pick(&self, lights: &[Light], at: WorldPoint, left: &mut f32) -> Option<(usize, f32)> {
        let (k, own) = pick(self.lights.iter().map(|&i| lights[i as usize].irradiance_at(at)), left)?;
        Some((self.lights[k] as usize, own))
    }
}

/// The first weight, with its index, at which the running sum passes `left`, which is less what came before; the last one
/// above 0 where rounding passes all.
fn pick(weights: impl Iterator<Item = f32>, left: &mut f32) -> Option<(usize, f32)> {
    let mut last = None;
    for (i, weight) in weights.enumerate() {
        if weight <= 0.0 {
            continue;
        }
        if *left < weight {
            return Some((i, weight));
        }
        *left -= weight;
        last = Some((i, weight));
    }
    *left = 0.0;
    last
}

/// Cuts lights in two across the longest edge of their box until no part has more than `size`.
fn halve(members: &mut [u32], lights: &[Light], size: usize, groups: &mut Vec<Group>) {
    if members.len() <= size {
        groups.push(Group::new(members, lights));
        return;
    }
    let place = |i: &u32| lights[*i as usize].place().map_or(Vec3::ZERO, |(p, _)| p.0);
    let edges = Aabb::from_points(members.iter().map(place)).size();
    let axis = edges.max_position();
    members.sort_by(|a, b| place(a)[axis].total_cmp(&place(b)[axis]).then(a.cmp(b)));
    let (low, high) = members.split_at_mut(members.len() / 2);
    halve(low, lights, size, groups);
    halve(high, lights, size, groups);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::{CounterRng, Seed};
    use crate::math::space::UnitVec3;
    use crate::math::statistics::chi_square_test;
    use crate::render::color::luminance;
    use crate::render::environment::Environment;
    use crate::render::spot::Spot;
    use crate::render::sun::Sun;

    fn lamps(count: usize, with_far: bool) -> Vec<Light> {
        let mut rng = CounterRng::new(Seed(8));
        let mut lights: Vec<Light> = (0..count)
            .map(|i| {
                let p = WorldPoint(Vec3::from([0; 3].map(|_| rng.uniform() * 6.0 - 3.0)));
                let intensity = Vec3::splat(0.2 + rng.uniform());
                if i % 5 == 4 {
                    Light::Spot(Spot::new(p, -UnitVec3::Y, intensity, 70.0, 0.3))
                } else {
                    Light::Point { position: p, intensity }
                }
            })
            .collect();
        if with_far {
            lights.insert(1, Light::Sun(Sun::new(-UnitVec3::Y, Vec3::splat(0.7), 0.0, false)));
            lights.push(Light::Environment(Environment::constant(Vec3::ONE, true)));
        }
        lights
    }

    #[test]
    fn lights_are_chosen_as_often_as_their_probability_says() {
        for (count, with_far) in [(1, true), (2, false), (20, true), (64, false), (200, true)] {
            let lights = lamps(count, with_far);
            let choice = LightChoice::new(&lights);
            for at in [WorldPoint::new(0.3, -0.2, 0.9), WorldPoint::new(-3.0, -4.0, 8.0)] {
                let n = 40_000;
                let mut counts = vec![0.0; lights.len()];
                let mut rng = CounterRng::new(Seed(2));
                for _ in 0..n {
                    let (i, pmf) = choice.choose(&lights, at, rng.uniform()).unwrap_or_else(|| {
                        assert!(count > WEIGHED_ALL, "only a group whose lights all point elsewhere gives none");
                        (usize::MAX, 0.0)
                    });
                    if let Some(found) = counts.get_mut(i) {
                        *found += 1.0;
                        let again = choice.pmf(&lights, at, i);
                        assert!((pmf / again - 1.0).abs() < 1e-3, "{pmf} {again}");
                    }
                }
                let probabilities: Vec<f64> = (0..lights.len()).map(|i| choice.pmf(&lights, at, i).into()).collect();
                let sum: f64 = probabilities.iter().sum();
                assert!(if count > WEIGHED_ALL { sum < 1.001 } else { (sum - 1.0).abs() < 1e-3 }, "{sum}");
                let none = counts.iter().fold(f64::from(n), |left, count| left - count);
                let mut expected: Vec<f64> = probabilities.iter().map(|p| p * f64::from(n)).collect();
                counts.push(none);
                expected.push((1.0 - sum).max(0.0) * f64::from(n));
                // Rare ones together.
                let rare: Vec<usize> = (0..counts.len()).filter(|&i| expected[i] < 8.0).collect();
                let (rest, rest_expected) = rare.iter().fold((0.0, 0.0), |(c, e), &i| (c + counts[i], e + expected[i]));
                let often = |v: &[f64], rest: f64| {
                    let mut all: Vec<f64> = (0..v.len()).filter(|i| expected[*i] >= 8.0).map(|i| v[i]).collect();
                    if rest_expected >= 8.0 {
                        all.push(rest);
                    }
                    all
                };
                let (c, e) = (often(&counts, rest), often(&expected, rest_expected));
                let p = if c.len() > 1 { chi_square_test(&c, &e) } else { 1.0 };
                assert!(p > 1e-3, "{count} lights, far {with_far}: p {p}");
            }
        }
    }

    /// Variance of one connection about the irradiance of all lamps, over its square: exact, lamp by lamp, for points all
    /// over the scene.
    fn relative_variance(lights: &[Light], pmf: impl Fn(WorldPoint, usize) -> f32) -> f64 {
        let mut rng = CounterRng::new(Seed(12));
        let n = 500;
        let at = |_| {
            let at = WorldPoint(Vec3::from([0; 3].map(|_| rng.uniform() * 6.0 - 3.0)));
            let (mut sum, mut square) = (0.0, 0.0);
            for (i, light) in lights.iter().enumerate() {
                let Some(s) = light.sample(at, [0.5, 0.5]) else { continue };
                let irradiance = f64::from(luminance(s.weight));
                sum += irradiance;
                square += irradiance * irradiance / f64::from(pmf(at, i));
            }
            square / (sum * sum) - 1.0
        };
        (0..n).map(at).sum::<f64>() / f64::from(n)
    }

    #[test]
    fn many_lamps_are_less_noisy_than_when_they_are_weighed_once() {
        for count in [64, 1000] {
            let lights: Vec<Light> =
                lamps(count * 5 / 4, false).into_iter().filter(|l| matches!(l, Light::Point { .. })).collect();
            let choice = LightChoice::new(&lights);
            let weighed = relative_variance(&lights, |at, i| choice.pmf(&lights, at, i));
            let once = relative_variance(&lights, |_, i| choice.far_pmf(i));
            let start = std::time::Instant::now();
            let n = 20_000;
            let sum: f32 = (0..n)
                .filter_map(|i| {
                    let u = i as f32 / n as f32;
                    Some(choice.choose(&lights, WorldPoint::new(u, 1.0 - u, 0.3), u)?.1)
                })
                .sum();
            let time = start.elapsed().as_secs_f64() / f64::from(n) * 1e9;
            println!("{count} lamps: variance {weighed:.3}, weighed once {once:.2}, {time:.0} ns a choice ({sum:.1})");
            // Alone, lamps in one group are chosen in proportion to what they give.
            assert!(weighed < 0.2 * once, "{count}: {weighed} {once}");
        }
    }

    #[test]
    fn what_gives_light_can_be_chosen() {
        for count in [3, 40, 150] {
            let lights = lamps(count, true);
            let choice = LightChoice::new(&lights);
            let mut rng = CounterRng::new(Seed(5));
            for _ in 0..200 {
                let at = WorldPoint(Vec3::from([0; 3].map(|_| rng.uniform() * 20.0 - 10.0)));
                for (i, light) in lights.iter().enumerate().filter(|(_, light)| light.place().is_some()) {
                    let gives = light.sample(at, [0.5, 0.5]).is_some_and(|s| luminance(s.weight) > 0.0);
                    assert_eq!(gives, choice.pmf(&lights, at, i) > 0.0, "light {i}");
                }
            }
        }
    }

    #[test]
    fn far_lights_alone_and_single_lamps_are_chosen_alike_everywhere() {
        let sky = || Light::Environment(Environment::constant(Vec3::ONE, true));
        let sun = |e: f32| Light::Sun(Sun::new(-UnitVec3::Y, Vec3::splat(e), 0.0, false));
        for lights in [vec![sun(1.0), sun(4.0), sky()], vec![sky(), lamps(1, false).remove(0)]] {
            let choice = LightChoice::new(&lights);
            assert!(choice.near.is_none());
            let pmf = |x: f32, i: usize| choice.pmf(&lights, WorldPoint::new(x, 0.0, 0.0), i);
            for i in 0..lights.len() {
                assert_eq!(pmf(0.0, i), pmf(50.0, i));
            }
        }
        let two = [sun(1.0), sun(4.0), sky()];
        let choice = LightChoice::new(&two);
        assert!((choice.pmf(&two, WorldPoint::default(), 0) - 1.0 / 3.0).abs() < 1e-6);
        assert!(choice.choose(&[sky()], WorldPoint::default(), 0.5).is_some());
    }
}
