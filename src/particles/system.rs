//! All particles of a scene, carried from step to step of the global time grid.
//!
//! A particle's path depends on nothing but its own birth and the field, so a frame computed alone (from the oldest
//! particle that may still live) is the same to the last bit as at the end of a sequence. So is one that is computed some
//! particles at a time, each batch carried from its birth and forgotten.

use crate::flow::field::VelocityField;
use crate::flow::kind::{Flow, FlowSpan};
use crate::math::parallel;
use crate::particles::advect::{Coordinates, Scheme, advance, evaluate};
use crate::particles::bend::bends;
use crate::particles::emit::{Birth, Emitter};
use crate::particles::follow::{IsoValues, Stride, follow, velocities};
use crate::particles::{Particles, ParticlesError};
use crate::progress::{Progress, Stage};
use std::ops::Range;
use std::sync::Arc;

/// Bits of an identity that hold the index within its emitter.
const INDEX_BITS: u32 = 44;

/// The time grid: step n runs from n to n+1 times `step` seconds, and frame f is at step `(f − first)·substeps`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeGrid {
    /// Number of the frame at time 0.
    pub first_frame: i32,
    /// Steps of a frame.
    pub substeps: u32,
    /// Frames per second.
    pub fps: f64,
}

impl TimeGrid {
    /// Time at which step `n` begins [s].
    pub fn time(&self, n: i64) -> f64 {
        // One division of exact numbers: the same in every order of evaluation.
        n as f64 / (self.fps * f64::from(self.substeps))
    }

    /// Length of a step [s].
    pub fn step(&self) -> f64 {
        1.0 / (self.fps * f64::from(self.substeps))
    }

    pub(in crate::particles) fn step_of_frame(&self, frame: i32) -> i64 {
        (i64::from(frame) - i64::from(self.first_frame)) * i64::from(self.substeps)
    }

    /// The last step that begins at or before a time.
    pub(in crate::particles) fn step_before(&self, time: f64) -> i64 {
        (time * self.fps * f64::from(self.substeps)).floor() as i64
    }
}

/// Size of the kernel that a particle is splatted with: radius² = radius0² + expansion²·age.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KernelSize {
    /// Of a new particle [m].
    pub initial_radius: f64,
    /// [m/√s].
    pub expansion: f64,
}

impl KernelSize {
    fn radius(&self, age: f32) -> f32 {
        (self.initial_radius.powi(2) + self.expansion.powi(2) * f64::from(age)).sqrt() as f32
    }
}

/// Some of the particles of an emitter, carried without all others.
#[derive(Debug, Clone)]
struct Window {
    emitter_idx: usize,
    indices: Range<u64>,
}

impl Window {
    /// Those of an emitter's candidates that are in the window.
    fn part_of(&self, emitter_idx: usize, candidates: Range<u64>) -> Range<u64> {
        if emitter_idx != self.emitter_idx {
            return 0..0;
        }
        let start = candidates.start.max(self.indices.start);
        start..candidates.end.min(self.indices.end).max(start)
    }
}

/// The particles of one emitter, in the order of their indices.
#[derive(Debug, Clone, Default)]
struct Cloud {
    position: Coordinates,
    /// Of flows along tracks; else empty.
    iso_values: IsoValues,
    birth: Vec<f64>,
    lifetime: Vec<f32>,
    index: Vec<u64>,
}

/// Particles in motion.
#[derive(Debug)]
pub struct ParticleSystem {
    flow: Arc<Flow>,
    emitters: Vec<Emitter>,
    grid: TimeGrid,
    scheme: Scheme,
    kernel: KernelSize,
    /// Between which times relative to a frame its shutter is open [s].
    shutter: [f64; 2],
    clouds: Vec<Cloud>,
    /// The step at whose beginning the clouds are.
    step: Option<i64>,
    phases: Vec<f32>,
    frame: Particles,
    /// Since the system was made.
    all: Way,
    /// As much of it as was before the way to the frame last asked for.
    before: Way,
    /// Whether the frame last asked for was reached.
    is_there: bool,
    particle_steps: u64,
}

/// What happened to particles on their way.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Way {
    /// Steps that ended inside an obstacle and were put back on its wall.
    pub penetrations: u64,
    /// Particles born.
    pub born: u64,
    /// Those of them that were born inside an obstacle and moved to its surface.
    pub born_inside: u64,
}

impl ParticleSystem {
    /// A system that is at no frame yet.
    pub fn new(
        flow: impl Into<Flow>,
        emitters: Vec<Emitter>,
        grid: TimeGrid,
        scheme: Scheme,
        kernel: KernelSize,
    ) -> Self {
        Self {
            clouds: vec![Cloud::default(); emitters.len()],
            flow: Arc::new(flow.into()),
            emitters,
            grid,
            scheme,
            kernel,
            shutter: [0.0; 2],
            step: None,
            phases: Vec::new(),
            frame: Particles::default(),
            all: Way::default(),
            before: Way::default(),
            is_there: false,
            particle_steps: 0,
        }
    }

    /// Says between which times relative to a frame its shutter is open [s]; without, it is not, and ways of particles do not
    /// bend.
    pub fn open_shutter(&mut self, shutter: [f64; 2]) {
        self.shutter = shutter;
    }

    /// What carries the particles.
    pub fn flow(&self) -> &Flow {
        &self.flow
    }

    /// The same to keep while particles are carried.
    pub fn shared_flow(&self) -> Arc<Flow> {
        self.flow.clone()
    }

    /// A field with the walls of the flow.
    pub fn walls(&self) -> &VelocityField {
        self.flow.walls()
    }

    /// Steps that ended inside an obstacle and were put back on its wall, since the system was made.
    pub fn penetrations(&self) -> u64 {
        self.all.penetrations
    }

    /// Particles that were born since the system was made.
    pub fn born(&self) -> u64 {
        self.all.born
    }

    /// What happened on the way to the frame last asked for: from the frame reached before it, or from the birth of the oldest
    /// particle where that one was of no use. A frame that is asked for again keeps its way.
    pub fn way(&self) -> Way {
        let (all, before) = (&self.all, &self.before);
        Way {
            penetrations: all.penetrations - before.penetrations,
            born: all.born - before.born,
            born_inside: all.born_inside - before.born_inside,
        }
    }

    /// The share of an emitter's first particles, 0 to 1, that are born inside obstacles or outside containers; none
    /// where it has no particles.
    pub fn share_born_inside(&self, emitter_idx: usize) -> Option<f64> {
        /// Enough to tell half of an emitter from less.
        const PARTICLES: u64 = 256;
        let emitter = self.emitters.get(emitter_idx)?;
        let births: Vec<_> = (0..PARTICLES).filter_map(|index| emitter.birth(index)).collect();
        let is_inside = |birth: &&Birth| self.walls().distance(birth.position.map(f64::from), birth.time) < 0.0;
        let inside = births.iter().filter(is_inside).count();
        (!births.is_empty()).then(|| inside as f64 / births.len() as f64)
    }

    /// Particles that were born inside an obstacle and moved to its surface, since the system was made.
    pub fn born_inside(&self) -> u64 {
        self.all.born_inside
    }

    /// Particle steps taken since the system was made.
    pub fn particle_steps(&self) -> u64 {
        self.particle_steps
    }

    /// The particles of the frame last asked for.
    pub fn particles(&self) -> &Particles {
        &self.frame
    }

    /// The particles alive at a frame. Frames may come in any order; going on from the one before is cheapest.
    ///
    /// # Errors
    /// Cancelled, or a particle has left all bounds. The system stays usable.
    pub fn at_frame(&mut self, frame: i32, progress: &dyn Progress) -> Result<&Particles, ParticlesError> {
        let target = self.grid.step_of_frame(frame);
        let oldest = self.oldest_step(target);
        // Particles that live at the target were born after `oldest`; going on pays only from a later state.
        let mut step = match self.step {
            Some(step) if step <= target && step >= oldest => {
                // What was cancelled on its way goes on with it.
                if self.is_there && step < target {
                    self.before = self.all;
                }
                step
            }
            _ => {
                self.clouds.iter_mut().for_each(Cloud::clear);
                self.before = self.all;
                oldest
            }
        };
        progress.begin(Stage::Advect, self.expected_work(step, target));
        let carried = self.carry(&mut step, target, None, progress);
        self.step = Some(step);
        self.is_there = carried.is_ok();
        progress.end(Stage::Advect);
        carried?;
        self.check_finite(frame)?;
        Ok(&self.frame)
    }

    /// How long a particle lives [s], by its identity; 0 of one that there never is.
    pub fn lifetime(&self, id: u64) -> f32 {
        let emitter = self.emitters.get((id >> INDEX_BITS) as usize);
        let birth = emitter.and_then(|emitter| emitter.birth(id & ((1 << INDEX_BITS) - 1)));
        birth.map_or(0.0, |birth| birth.lifetime)
    }

    /// Calls `visit` with the particles alive at a frame, at most `batch` at a time, in the order in which
    /// [`ParticleSystem::at_frame`] has them. Each batch is carried from its birth, whatever frame was asked for before, so that no
    /// more particles than that are ever held; nothing is kept.
    ///
    /// # Errors
    /// Those of [`ParticleSystem::at_frame`] and of `visit`, which ends the visits.
    pub fn visit_batches<E: From<ParticlesError>>(
        &mut self,
        frame: i32,
        batch: u64,
        progress: &dyn Progress,
        visit: &mut dyn FnMut(&Particles) -> Result<(), E>,
    ) -> Result<(), E> {
        let target = self.grid.step_of_frame(frame);
        let oldest = self.oldest_step(target);
        self.step = None;
        self.before = self.all;
        progress.begin(Stage::Advect, self.expected_work(oldest, target));
        let visited = (0..self.emitters.len()).try_for_each(|emitter_idx| {
            let all = self.emitters[emitter_idx].candidates(self.grid.time(oldest), self.grid.time(target));
            let mut first = all.start;
            while first < all.end {
                let end = first.saturating_add(batch.max(1)).min(all.end);
                let earliest = self.grid.step_before(self.emitters[emitter_idx].earliest_birth(first));
                let mut step = earliest.saturating_sub(1).clamp(oldest, target);
                self.clouds.iter_mut().for_each(Cloud::clear);
                self.carry(&mut step, target, Some(&Window { emitter_idx, indices: first..end }), progress)?;
                self.check_finite(frame)?;
                if !self.frame.is_empty() {
                    visit(&self.frame)?;
                }
                first = end;
            }
            Ok(())
        });
        progress.end(Stage::Advect);
        self.clouds.iter_mut().for_each(|cloud| *cloud = Cloud::default());
        self.frame = Particles::default();
        visited
    }

    /// Takes the clouds from `step` to `target`, with the particles that are born on the way, of a window where one is given, and
    /// fills the frame. Where cancelled, `step` is left at the step that was reached.
    fn carry(
        &mut self,
        step: &mut i64,
        target: i64,
        window: Option<&Window>,
        progress: &dyn Progress,
    ) -> Result<(), ParticlesError> {
        let flow = self.flow.clone();
        let mut span = flow.span(self.grid.time(*step), self.grid.step());
        while *step < target {
            if progress.is_cancelled() {
                return Err(ParticlesError::Cancelled);
            }
            progress.advance(self.take_step(*step, window, &mut span));
            *step += 1;
        }
        self.collect(self.grid.time(target));
        Ok(())
    }

    fn check_finite(&self, frame: i32) -> Result<(), ParticlesError> {
        if self.frame.position.iter().flatten().any(|x| !x.is_finite()) {
            return Err(ParticlesError::NotFinite { frame });
        }
        Ok(())
    }

    /// The latest step before which no particle was born that may live at the beginning of step `target`.
    fn oldest_step(&self, target: i64) -> i64 {
        let time = self.grid.time(target);
        let first_births = self.emitters.iter().map(|e| (time - e.longest_life()).max(e.start));
        let oldest = first_births.fold(time, f64::min);
        // One more than needed, for rounding.
        self.grid.step_before(oldest).saturating_sub(1).min(target)
    }

    fn expected_work(&self, from: i64, to: i64) -> u64 {
        // A sequence may be long and the estimate is only for people: a few hundred samples.
        let stride = ((to - from) / 256).max(1);
        let live = |n: i64| self.emitters.iter().map(|e| e.expected_live(self.grid.time(n + 1))).sum::<f64>();
        (from..to).step_by(stride as usize).map(|n| live(n) * stride as f64).sum::<f64>() as u64
    }

    /// Takes all clouds from the beginning of a step to its end; returns the number of particle steps. Only particles of the
    /// window, where one is given, are born. `span` is any of the flow's, for its memory.
    fn take_step(&mut self, step: i64, window: Option<&Window>, span: &mut FlowSpan) -> u64 {
        let (start, end) = (self.grid.time(step), self.grid.time(step + 1));
        let duration = self.grid.step();
        span.renew(start, duration);
        let mut work = 0;
        for (emitter_idx, (cloud, emitter)) in self.clouds.iter_mut().zip(&self.emitters).enumerate() {
            let older = cloud.index.len();
            self.phases.clear();
            let candidates = emitter.candidates(start, end);
            let candidates = window.map_or(candidates.clone(), |window| window.part_of(emitter_idx, candidates));
            let newborn = parallel::gather((candidates.end - candidates.start) as usize, |n, newborn| {
                let index = candidates.start + n as u64;
                let Some(birth) = emitter.birth(index).filter(|b| b.time > start && b.time <= end) else { return };
                let phase = (((birth.time - start) / duration) as f32).clamp(0.0, 1.0);
                let (position, moved) = span.walls().pushed_out(birth.position, f64::from(phase));
                newborn.push((index, birth, phase, position, moved));
            });
            for (index, birth, phase, position, moved) in newborn {
                self.all.born += 1;
                self.all.born_inside += u64::from(moved);
                cloud.push(index, &birth, position, self.flow.iso_values(position.map(f64::from)));
                self.phases.push(phase);
            }
            let (all, phases) = (cloud.index.len(), Some(self.phases.as_slice()));
            for (range, phases) in [(0..older, None), (older..all, phases)] {
                let Cloud { position, iso_values, .. } = cloud;
                self.all.penetrations += match span {
                    FlowSpan::Curl(span) => advance(span, self.scheme, duration, position, range, phases),
                    FlowSpan::Tracks(tracks, walls) => {
                        let stride = Stride { tracks, walls, integrator: self.scheme.integrator, duration };
                        follow(stride, position, iso_values, range, phases)
                    }
                };
            }
            work += cloud.index.len() as u64;
            cloud.bury(end);
        }
        self.particle_steps += work;
        work
    }

    /// Fills the frame from the clouds.
    fn collect(&mut self, time: f64) {
        let frame = &mut self.frame;
        frame.clear();
        for (e, (cloud, emitter)) in self.clouds.iter().zip(&self.emitters).enumerate() {
            for axis in 0..3 {
                frame.position[axis].extend_from_slice(&cloud.position[axis]);
            }
            let (first, kernel) = (frame.id.len(), self.kernel);
            frame.id.extend(cloud.index.iter().map(|index| (e as u64) << INDEX_BITS | index));
            frame.age.extend(cloud.birth.iter().map(|birth| (time - birth) as f32));
            let age = &frame.age[first..];
            frame.mass.resize(frame.age.len(), 0.0);
            parallel::for_each_mut(&mut frame.mass[first..], |i, mass| *mass = emitter.mass(age[i], cloud.lifetime[i]));
            frame.radius.resize(frame.age.len(), 0.0);
            parallel::for_each_mut(&mut frame.radius[first..], |i, radius| *radius = kernel.radius(age[i]));
        }
        let count = frame.id.len();
        frame.velocity.iter_mut().for_each(|v| v.resize(count, 0.0));
        match &*self.flow {
            Flow::Curl(field) => evaluate(&field.span(time, 0.0), &frame.position, &mut frame.velocity),
            Flow::Tracks(tracks) => velocities(tracks, &frame.position, &mut frame.velocity),
        }
        let is_open = self.shutter != [0.0; 2];
        frame.bends =
            is_open.then(|| bends(&self.flow, time, self.shutter, &frame.position, &frame.velocity, &frame.radius));
    }
}

impl Cloud {
    fn clear(&mut self) {
        self.position.iter_mut().chain(&mut self.iso_values).for_each(Vec::clear);
        self.birth.clear();
        self.lifetime.clear();
        self.index.clear();
    }

    fn push(&mut self, index: u64, birth: &Birth, position: [f32; 3], iso_values: Option<[f64; 2]>) {
        for (array, x) in self.position.iter_mut().zip(position) {
            array.push(x);
        }
        for (array, value) in self.iso_values.iter_mut().zip(iso_values.into_iter().flatten()) {
            array.push(value as f32);
        }
        self.birth.push(birth.time);
        self.lifetime.push(birth.lifetime);
        self.index.push(index);
    }

    /// Removes particles whose life is over at `time` [s]; the others keep their order.
    fn bury(&mut self, time: f64) {
        let is_over = |i: &usize| time - self.birth[*i] >= f64::from(self.lifetime[*i]);
        let Some(first_over) = (0..self.index.len()).find(is_over) else { return };
        let mut kept = first_over;
        for i in first_over..self.index.len() {
            if time - self.birth[i] < f64::from(self.lifetime[i]) {
                self.position.iter_mut().for_each(|a| a[kept] = a[i]);
                self.iso_values.iter_mut().filter(|a| !a.is_empty()).for_each(|a| a[kept] = a[i]);
                self.birth[kept] = self.birth[i];
                self.lifetime[kept] = self.lifetime[i];
                self.index[kept] = self.index[i];
                kept += 1;
            }
        }
        self.position.iter_mut().chain(&mut self.iso_values).for_each(|a| a.truncate(kept));
        self.birth.truncate(kept);
        self.lifetime.truncate(kept);
        self.index.truncate(kept);
    }
}
