//! The search for the steps of one state.

use alloc::vec;
use alloc::vec::Vec;

use super::ladder::{Pair, extrapolate, irregular, kinked, slow};
use super::{Error, MOST_PAIRS, Options, UNKNOWN, change, norm, power};

/// First step, as a part of the size of the state.
const FIRST: f64 = 1.0 / 64.0;
/// Spacing of those points: no power of two, and another for each of a few states.
const PARTS: [f64; 8] = [1.625, 1.875, 1.0625, 1.1875, 1.3125, 1.4375, 1.5625, 1.6875];
/// Stated over standard deviation, for the part of an error that is noise.
const COVERAGE: f64 = 3.0;
/// Part of the longest step down to which a law must hold to be taken for one all the way.
const FALLEN: f64 = 1.0 / 8192.0;
/// Part of a step at which detail that the step missed is straight.
const SHORT: f64 = 1.0 / (1u64 << 40) as f64;
/// Even over odd part of a change above which a step is too long.
const BENT: f64 = 0.25;

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Phase {
    /// No step is known yet at which the function is nearly linear.
    Search,
    /// Shorter steps follow the first good one.
    Ladder,
    /// The ladder did not settle: far shorter steps tell noise from detail.
    Detail,
    Done,
}

/// Noise nearly as large as the change over a step: detail far finer than the step looks alike.
#[derive(Clone, Copy)]
pub(super) struct Suspicion {
    /// Which pair tells: at a step so short that detail is straight, and noise as it was.
    pub pair: usize,
    /// What passes for noise, weighted.
    pub level: f64,
    /// Where the ladder goes on if it is noise.
    pub next: f64,
}

pub(super) struct Column<'a> {
    pub state: usize,
    pub outputs: Option<&'a [usize]>,
    pub pairs: Vec<Pair>,
    pub next: f64,
    pub least: f64,
    pub most: f64,
    /// Whether the state may be a zero and its rounding: neither scale nor step is given.
    pub rounded: bool,
    pub phase: Phase,
    pub shrunk: usize,
    pub grown: usize,
    /// From which pair on they belong to the ladder.
    pub anchor: usize,
    /// Whether only detail far below the first steps is trusted, and from where on.
    pub detail: Option<usize>,
    /// Whether no step was found at which noise is small.
    pub noisy: bool,
    /// Which pair is at the shortest step, after others that all met about the same change.
    pub probe: Option<usize>,
    /// What passes for noise and may be detail that all steps have missed.
    pub suspicion: Option<Suspicion>,
    /// The shortest step at which there may be detail, where noise hides it.
    pub reach: f64,
    /// How many pairs it may take.
    pub room: usize,
}

impl<'a> Column<'a> {
    pub(super) fn new(
        state: usize,
        x: f64,
        scale: f64,
        step: f64,
        outputs: Option<&'a [usize]>,
    ) -> Self {
        let size = if scale > 0.0 {
            scale
        } else if x == 0.0 {
            1.0
        } else {
            x.abs()
        };
        let ulp = power(x.abs().max(f64::MIN_POSITIVE)) * f64::EPSILON;
        let least = 4.0 * ulp;
        let given = step > 0.0;
        let first = if given { step } else { FIRST * size };
        Self {
            state,
            outputs,
            pairs: Vec::new(),
            next: power(first).max(least),
            least,
            // Past eight times its own size a state is somewhere else.
            most: if given {
                step
            } else if x == 0.0 || scale > 0.0 {
                f64::INFINITY
            } else {
                8.0 * size
            },
            rounded: !(given || scale > 0.0),
            phase: Phase::Search,
            shrunk: 0,
            grown: 0,
            anchor: 0,
            detail: None,
            noisy: false,
            probe: None,
            suspicion: None,
            reach: 0.0,
            room: MOST_PAIRS,
        }
    }

    pub(super) fn each(&self, m: usize) -> impl Iterator<Item = usize> + '_ {
        let count = self.outputs.map_or(m, <[usize]>::len);
        (0..count).map(move |k| self.outputs.map_or(k, |o| o[k]))
    }

    pub(super) fn wants(&self, measured: bool) -> bool {
        match self.phase {
            Phase::Done => false,
            Phase::Search => true,
            Phase::Ladder | Phase::Detail => measured,
        }
    }

    /// Ends where no evaluation is left.
    pub(super) fn stop<E>(&mut self) -> Result<(), Error<E>> {
        if self.phase == Phase::Search {
            let Some(last) = self.pairs.iter().rposition(|p| p.finite) else {
                return Err(self.not_finite());
            };
            self.anchor = last;
            if self.shrunk > 0 && self.grown == 0 {
                self.reach = self.unresolved();
            }
        }
        self.phase = Phase::Done;
        Ok(())
    }

    /// How short detail may be that was not found.
    fn unresolved(&self) -> f64 {
        if self.least > 1e-300 {
            return self.least;
        }
        let steps = self.pairs.iter().map(|p| p.step);
        steps.fold(f64::INFINITY, f64::min) * 1e-12
    }

    /// The error of the last pair, which is not finite.
    fn not_finite<E>(&self) -> Error<E> {
        let place = self.pairs.last().and_then(|pair| {
            let mut parts = pair.odd.iter().zip(&pair.even);
            parts.position(|(o, e)| !(o + e).is_finite())
        });
        let output = place.unwrap_or(0);
        Error::NotFinite {
            output: self.output(output),
            state: self.state,
            step: self.pairs.last().map_or(self.next, |pair| pair.step),
        }
    }

    pub(super) fn longest(&self) -> f64 {
        self.used().map(|p| p.step).fold(0.0, f64::max)
    }

    pub(super) fn take(&mut self, at: &[f64], above: &[f64], below: &[f64], period: &[f64]) {
        let (mut odd, mut even) = (Vec::new(), Vec::new());
        for i in self.each(at.len()) {
            let up = change(above[i], at[i], period[i]);
            let down = change(below[i], at[i], period[i]);
            odd.push(0.5 * (up - down));
            even.push(0.5 * (up + down));
        }
        self.keep(odd, even);
    }

    fn keep(&mut self, odd: Vec<f64>, even: Vec<f64>) {
        let finite = odd.iter().chain(&even).all(|x| x.is_finite());
        self.pairs.push(Pair {
            step: self.next,
            odd,
            even,
            finite,
        });
    }

    /// Takes the two nearest pairs of the line along which noise was measured, where there
    /// is no other state: they are steps of the ladder as any.
    pub(super) fn take_line(
        &mut self,
        at: &[f64],
        far: &[f64],
        spacing: f64,
        options: &Options<'_>,
    ) {
        if self.phase != Phase::Ladder {
            return;
        }
        let next = self.next;
        for (k, pair) in far.chunks_exact(2 * at.len()).take(2).enumerate() {
            let (mut below, mut above) = pair.split_at(at.len());
            if spacing < 0.0 {
                core::mem::swap(&mut below, &mut above);
            }
            self.next = spacing.abs() * (k + 1) as f64;
            self.take(at, above, below, options.period);
        }
        self.next = next;
    }

    /// Takes the pair that is wanted next from those there are; false where it is new.
    pub(super) fn take_again(&mut self) -> bool {
        let next = self.next;
        let Some(pair) = self.pairs.iter_mut().find(|p| p.step == next) else {
            return false;
        };
        pair.finite = false;
        let (odd, even) = (pair.odd.clone(), pair.even.clone());
        self.keep(odd, even);
        true
    }

    /// Which output the k-th of those that the state may move is.
    fn output(&self, k: usize) -> usize {
        self.outputs
            .map_or(Some(k), |o| o.get(k).copied())
            .unwrap_or(0)
    }

    /// Refuses an output with a kink that shows at every step down to its noise.
    fn check_kink<E>(&self, noise: &[f64]) -> Result<(), Error<E>> {
        for (k, i) in self.each(noise.len()).enumerate() {
            let above = |p: &&Pair| p.finite && p.even[k].abs() > 100.0 * noise[i];
            let seen: Vec<&Pair> = self.pairs.iter().filter(above).collect();
            if self.shrunk > 1 && seen.len() > 2 && kinked(&seen, k, noise[i], 4.0) {
                return Err(Error::Kink {
                    output: i,
                    state: self.state,
                    step: seen[seen.len() - 1].step,
                });
            }
        }
        Ok(())
    }

    fn bent(&self, pair: usize, weight: &[f64], noise: &[f64]) -> bool {
        let [odd, even, _] = self.sizes(&self.pairs[pair], weight, noise);
        even > BENT * odd
    }

    /// Lengths of the odd part, the even part and the noise of a pair, weighted.
    fn sizes(&self, pair: &Pair, weight: &[f64], noise: &[f64]) -> [f64; 3] {
        let m = noise.len();
        let of = |values: &[f64]| norm(self.each(m).zip(values).map(|(i, x)| x * weight[i]));
        [
            of(&pair.odd),
            of(&pair.even),
            norm(self.each(m).map(|i| noise[i] * weight[i])),
        ]
    }

    /// How far apart the points are at which noise is measured: parts of a power of two
    /// that leave x + k s exact, yet are none themselves, or numbers of fewer digits would
    /// not be seen. Each state has a part of its own: a difference of two states that move
    /// alike would stand still, and be taken for a rounded one.
    ///
    /// `longest` is that of the wide ones, as a part of the step, but for a noise that wants more.
    pub(super) fn spacing(&self, wide: bool, longest: f64, weight: &[f64], noise: &[f64]) -> f64 {
        let Some(pair) = self.pairs.get(self.detail.unwrap_or(self.anchor)) else {
            return 0.0;
        };
        let [odd, even, level] = self.sizes(pair, weight, noise);
        let own = PARTS[self.state % PARTS.len()];
        let part = if wide {
            // Where nothing moved nothing is bent, but farther away it may be.
            let (bent, longest) = if odd > 0.0 {
                (even / odd, if level > 1e-3 * odd { 1.0 } else { longest })
            } else {
                (0.0, 0.125)
            };
            own * power((0.02 / bent).clamp(2.0_f64.powi(-20), longest))
        } else {
            own / 8192.0
        };
        let sign = if (self.state * 7 + 3) % 5 < 2 {
            -1.0
        } else {
            1.0
        };
        sign * (pair.step * part).max(0.5 * self.least)
    }

    fn shorter<E>(
        &mut self,
        bits: i32,
        at: &[f64],
        weight: &[f64],
        noise: &[f64],
    ) -> Result<(), Error<E>> {
        let last = self.pairs.len() - 1;
        let pair = &self.pairs[last];
        let level = self.level_off(weight, noise);
        let short = power((self.pairs[0].step * SHORT).max(4.0 * self.least));
        if level && self.probe.is_none() && self.pairs.len() < self.room && short < pair.step / 64.0
        {
            self.probe = Some(self.pairs.len());
            self.next = short;
            self.shrunk += 1;
            return Ok(());
        }
        // The same change from long steps to the shortest is noise, not detail.
        let settled = level && self.probe == Some(last);
        // At zero a law such as x |x| is followed at once to where nothing is left of it.
        let law = self.least < 1e-300 && self.shrunk == 0 && last > 0;
        let bits = if law && self.falls(weight, noise.len()) {
            let [before, ..] = self.sizes(&self.pairs[last - 1], weight, noise);
            let [odd, _, level] = self.sizes(pair, weight, noise);
            let far = if odd < 0.18 * before { 14 } else { 28 };
            // Only as far as rounding leaves something of it.
            if odd * 4.0_f64.powi(-far) > 8.0 * level {
                far
            } else {
                bits
            }
        } else {
            bits
        };
        let next = (pair.step * 2.0_f64.powi(-bits)).max(self.least);
        if !settled && self.pairs.len() + 2 < self.room && next < pair.step {
            self.next = power(next);
            self.shrunk += 1;
            return Ok(());
        }
        // No step is short enough: noise, a kink or a jump.
        self.check_kink(noise)?;
        let m = at.len();
        let size = |x: &[f64]| norm(self.each(m).zip(x).map(|(i, x)| weight[i] * x));
        if let Some(longest) = self.pairs.iter().position(|p| p.finite)
            && pair.finite
            && !self.jumps(weight, m)
        {
            let local = 5.0 * size(&pair.odd).max(size(&pair.even));
            // The shortest step at which the change is above what is left at the end.
            let best = (0..last)
                .filter(|&k| self.pairs[k].finite && size(&self.pairs[k].odd) > local)
                .min_by(|&a, &b| self.pairs[a].step.total_cmp(&self.pairs[b].step))
                .unwrap_or(longest);
            if self.falls_to_nothing(weight, m) {
                // As x^3 at 0: straight nowhere, but with a slope that goes to zero.
                self.anchor = longest;
                self.phase = Phase::Done;
                return Ok(());
            }
            let first = self.pairs[best].step;
            self.reach = if settled { 0.0 } else { self.unresolved() };
            for p in &mut self.pairs {
                p.finite &= p.step >= first;
            }
            self.noisy = true;
            self.anchor = best;
            self.phase = Phase::Ladder;
            self.next = 0.5 * first;
            return Ok(());
        }
        let pair = &self.pairs[last];
        if !pair.finite {
            return Err(self.not_finite());
        }
        let (mut place, mut largest) = (0, -1.0);
        for (k, i) in self.each(m).enumerate() {
            let size = weight[i] * (pair.odd[k].abs() + pair.even[k].abs());
            if size > largest {
                (place, largest) = (k, size);
            }
        }
        let output = self.each(m).nth(place).unwrap_or(0);
        if self.turns(weight, m) {
            return Err(Error::Kink {
                output,
                state: self.state,
                step: pair.step,
            });
        }
        Err(Error::Jump {
            output,
            state: self.state,
            below: at[output] + pair.even[place] - pair.odd[place],
            above: at[output] + pair.even[place] + pair.odd[place],
            step: pair.step,
        })
    }

    /// Whether the last step meets about the same change as one far longer, but not the very
    /// same, as at a jump.
    fn level_off(&self, weight: &[f64], noise: &[f64]) -> bool {
        let Some((short, longer)) = self.pairs.split_last() else {
            return false;
        };
        let Some(long) = longer.iter().rfind(|p| p.step > 16.0 * short.step) else {
            return false;
        };
        let change = |pair: &Pair| {
            let [odd, even, level] = self.sizes(pair, weight, noise);
            (odd.max(even), level)
        };
        let ((first, _), (second, level)) = (change(long), change(short));
        long.finite
            && short.finite
            && second > 0.3 * first
            && second > 8.0 * level
            && !self.jumps(weight, noise.len())
    }

    /// Whether the shortest steps all meet the same change, which noise does not.
    fn jumps(&self, weight: &[f64], m: usize) -> bool {
        let Some([.., a, b]) = self.pairs.get(self.pairs.len().saturating_sub(2)..) else {
            return false;
        };
        let size = |x: &[f64], y: &[f64]| {
            norm(
                self.each(m)
                    .enumerate()
                    .map(|(k, i)| weight[i] * (x[k] - y[k])),
            )
        };
        let none = vec![0.0; a.odd.len()];
        let apart = size(&a.odd, &b.odd) + size(&a.even, &b.even);
        apart < 0.05 * (size(&none, &b.odd) + size(&none, &b.even)) || self.turns(weight, m)
    }

    /// Whether the even part falls with the step, as fast as it is long, down to the shortest
    /// steps: a kink.
    fn turns(&self, weight: &[f64], m: usize) -> bool {
        let Some([a, b]) = self.pairs.get(self.pairs.len().saturating_sub(2)..) else {
            return false;
        };
        let ratio = b.step / a.step;
        let (mut off, mut whole) = (0.0, 0.0);
        for (k, i) in self.each(m).enumerate() {
            off = crate::scalar::hypot(off, weight[i] * (a.even[k] * ratio - b.even[k]));
            whole = crate::scalar::hypot(whole, weight[i] * b.even[k]);
        }
        off < 0.05 * whole
    }

    /// Whether slope and bend fall all along, by half the decades of the steps or more: that
    /// of noise, of a jump or of a kink does not.
    fn falls_to_nothing(&self, weight: &[f64], m: usize) -> bool {
        let steps = || self.pairs.iter().filter(|p| p.finite).map(|p| p.step);
        let longest = steps().fold(0.0, f64::max);
        let shortest = steps().fold(f64::INFINITY, f64::min);
        // The size of a state that is not zero says nothing of how short is short.
        let least = if self.least < 1e-300 {
            FALLEN
        } else {
            FALLEN * FALLEN
        };
        steps().count() > 3 && shortest < least * longest && self.falls(weight, m)
    }

    /// The same of fewer steps.
    fn falls(&self, weight: &[f64], m: usize) -> bool {
        let size = |x: &[f64]| norm(self.each(m).zip(x).map(|(i, x)| weight[i] * x));
        let mut pairs: Vec<&Pair> = self.pairs.iter().filter(|p| p.finite).collect();
        pairs.sort_by(|a, b| b.step.total_cmp(&a.step));
        pairs.len() > 1
            && pairs.windows(2).all(|w| {
                let least = (w[1].step / w[0].step).sqrt();
                let slope = |x: &[f64], p: &Pair| size(x) / p.step;
                slope(&w[1].odd, w[1]) <= least * slope(&w[0].odd, w[0])
                    && slope(&w[1].even, w[1]) <= least * slope(&w[0].even, w[0])
            })
    }

    /// What to do after the last pair.
    ///
    /// `plain` is the noise without that of printed digits, which a longer step does not better.
    pub(super) fn decide<E>(
        &mut self,
        weight: &[f64],
        noise: &[f64],
        plain: &[f64],
        at: &[f64],
    ) -> Result<(), Error<E>> {
        match self.phase {
            Phase::Search => self.search(weight, noise, plain, at),
            Phase::Ladder => {
                self.climb(weight, noise);
                Ok(())
            }
            Phase::Detail => {
                self.compare(weight, noise);
                Ok(())
            }
            Phase::Done => Ok(()),
        }
    }

    fn search<E>(
        &mut self,
        weight: &[f64],
        noise: &[f64],
        plain: &[f64],
        at: &[f64],
    ) -> Result<(), Error<E>> {
        let last = self.pairs.len() - 1;
        let pair = &self.pairs[last];
        // Far steps first cost little; then as far as the numbers reach in a few.
        let bits = [5, 10, 14, 14, 14, 14, 14, 14, 14][self.shrunk.min(8)];
        if !pair.finite {
            return self.shorter(bits, at, weight, noise);
        }
        let [odd, even, level] = self.sizes(pair, weight, noise);
        if let Some(Suspicion {
            level: seen, next, ..
        }) = self.suspicion.filter(|suspicion| suspicion.pair == last)
        {
            let detail = 0.05 * seen * pair.step / odd;
            let rounding = odd.max(even) < 8.0 * level;
            if rounding || odd.max(even) > 0.1 * seen || !(detail < self.pairs[self.anchor].step) {
                self.pairs[last].finite = false;
                self.phase = Phase::Ladder;
                self.next = next;
            } else {
                self.next = power(detail).max(self.least);
            }
            return Ok(());
        }
        if self.probe == Some(last) && odd < 8.0 * level && even < 8.0 * level {
            // Nothing moves at so short a step: half way.
            self.next = power((pair.step * self.pairs[last - 1].step).sqrt());
            self.pairs[last].finite = false;
            return Ok(());
        }
        if self.probe == Some(last) && odd > 8.0 * level && even <= BENT * odd {
            let [long_odd, long_even, _] = self.sizes(&self.pairs[last - 1], weight, noise);
            let whole = long_odd.max(long_even);
            let next = power(0.05 * whole * pair.step / odd);
            if odd < 0.1 * whole && next > 4.0 * pair.step && next < self.pairs[last - 1].step {
                // Straight here: as far as a twentieth of the whole change.
                self.next = next;
                return Ok(());
            }
        }
        if odd < 8.0 * level && even < 8.0 * level {
            // Nothing moves.
            let longer = power((pair.step * 4096.0).min(self.most));
            self.check_kink(noise)?;
            if self.shrunk > 0 && self.grown > 0 && self.bent(last - 1, weight, noise) {
                // Flat at x, and something else far away.
                self.anchor = last;
                self.phase = Phase::Ladder;
                self.next = 0.5 * pair.step;
            } else if self.shrunk > 0 {
                // Not below the last step that moved something: that was noise.
                self.anchor = (0..last).rfind(|&k| self.pairs[k].finite).unwrap_or(last);
                self.phase = Phase::Ladder;
                self.next = power((pair.step * self.pairs[self.anchor].step).sqrt());
            } else if self.grown < 4 && longer > 2.0 * pair.step {
                self.grown += 1;
                self.next = longer;
            } else if !self.as_zero() {
                self.anchor = last;
                self.phase = Phase::Ladder;
                self.next = 0.5 * self.pairs[last].step;
            }
            return Ok(());
        }
        let longer = power((pair.step * 4096.0).min(self.most));
        let [.., digits] = self.sizes(pair, weight, plain);
        if self.shrunk == 0 && self.grown < 4 && odd < 1e7 * digits && even < 8.0 * digits {
            // Straight, and little above rounding: a longer step has more digits.
            if longer > 2.0 * pair.step {
                self.grown += 1;
                self.next = longer;
                return Ok(());
            }
            if self.as_zero() {
                return Ok(());
            }
        }
        let pair = &self.pairs[last];
        let lawful = last > 0 && self.pairs[last - 1].finite && {
            let before = &self.pairs[last - 1];
            let ratio = pair.step / before.step;
            let m = noise.len();
            let off = |a: &[f64], b: &[f64], power: f64| {
                norm(
                    self.each(m)
                        .zip(a.iter().zip(b))
                        .map(|(i, (x, y))| weight[i] * (x - power * y)),
                )
            };
            off(&pair.odd, &before.odd, ratio) <= 0.1 * odd + 8.0 * level
                && off(&pair.even, &before.even, ratio * ratio)
                    <= 0.3 * even + 0.05 * odd + 8.0 * level
        };
        let confirming = last > 0 && self.pairs[last - 1].step <= 2.5 * pair.step;
        if lawful {
            self.anchor = if confirming { last - 1 } else { last };
            self.phase = Phase::Ladder;
            self.next = 0.5 * pair.step;
            return Ok(());
        }
        // One step that looks straight may be chance: the next must agree.
        let next = 0.5 * pair.step;
        if even > BENT * odd || confirming || next < self.least || last + 2 > self.room {
            return self.shorter(bits, at, weight, noise);
        }
        self.next = next;
        Ok(())
    }

    /// Moves a state as a zero is moved, once: what shows little or nothing within its own size
    /// may be a zero and its rounding, the cosine of a right angle.
    fn as_zero(&mut self) -> bool {
        let shown = self.pairs.last().is_some_and(|pair| pair.step < FIRST);
        if !(self.rounded && shown) {
            return false;
        }
        self.rounded = false;
        self.most = f64::INFINITY;
        self.next = FIRST;
        true
    }

    /// Once the noise is known, a longer step may be better.
    ///
    /// Returns whether the step was chance instead, and the search goes on.
    ///
    /// `unexplained` is the noise that is not that of printed digits.
    pub(super) fn after_noise(
        &mut self,
        enough: bool,
        weight: &[f64],
        noise: &[f64],
        unexplained: &[f64],
    ) -> bool {
        if self.phase != Phase::Ladder {
            return false;
        }
        let pair = &self.pairs[self.anchor];
        let [odd, even, level] = self.sizes(pair, weight, noise);
        if odd == 0.0 {
            return false;
        }
        let [.., unexplained] = self.sizes(pair, weight, unexplained);
        if unexplained > 0.02 * odd && !self.noisy && self.suspicion.is_none() && enough {
            // What looks like noise may be detail that all steps so far have missed.
            let next = power((pair.step * SHORT).max(4.0 * self.least));
            if next < pair.step / 64.0 {
                self.suspicion = Some(Suspicion {
                    pair: self.pairs.len(),
                    level,
                    next: self.next,
                });
                self.phase = Phase::Search;
                self.next = next;
                self.shrunk = self.shrunk.max(3);
                return true;
            }
        }
        let bend = (even / odd).max(2.0 * level / odd);
        // Error of the ladder from noise, and how much longer the step may be.
        let wanted = if level > 1e-3 * odd { 0.15 } else { 0.06 };
        let factor = if level > 0.02 * odd && even < 3.0 * level {
            // Nothing is seen of a bend.
            (200.0 * level / odd).min(64.0)
        } else {
            (wanted / bend).min(64.0)
        };
        if level > 1e-11 * odd && factor > 2.0 {
            let longer = power((pair.step * factor).min(self.most));
            if longer > pair.step {
                self.next = longer;
            }
        }
        false
    }

    /// The pairs of the ladder, from long to short steps.
    pub(super) fn used(&self) -> impl DoubleEndedIterator<Item = &Pair> {
        let first = self.detail.unwrap_or(self.anchor);
        let mut pairs: Vec<&Pair> = self.pairs[first.min(self.pairs.len())..]
            .iter()
            .filter(|p| p.finite)
            .collect();
        pairs.sort_by(|a, b| b.step.total_cmp(&a.step));
        pairs.into_iter()
    }

    fn climb(&mut self, weight: &[f64], noise: &[f64]) {
        let last = self.pairs.len() - 1;
        let m = noise.len();
        if !self.pairs[last].finite {
            // A step too long was tried.
            self.most = self.most.min(0.5 * self.pairs[last].step);
        } else if self.pairs[last].step > self.pairs[self.anchor].step {
            let [odd, even, level] = self.sizes(&self.pairs[last], weight, noise);
            let ratio = self.pairs[last].step / self.pairs[self.anchor].step;
            let [first, ..] = self.sizes(&self.pairs[self.anchor], weight, noise);
            if even > BENT * odd || !(odd > 0.5 * ratio * (first - 4.0 * level)) {
                // Bent: not part of the ladder.
                self.pairs[last].finite = false;
            }
        }
        let steps: Vec<f64> = self.used().map(|p| p.step).collect();
        let room = self.pairs.len() < self.room;
        if steps.len() < 3 {
            if !room || steps.is_empty() {
                self.phase = Phase::Done;
                return;
            }
            self.next = if steps.len() == 2 && steps[0] > 2.5 * steps[1] {
                power((steps[0] * steps[1]).sqrt() * 1.42)
            } else {
                0.5 * steps[steps.len() - 1]
            };
            if self.next < self.least || steps.contains(&self.next) {
                self.phase = Phase::Done;
            }
            return;
        }
        if self.noisy && self.lawful(weight, noise) {
            self.reach = 0.0;
        }
        let (mut value, mut random, mut rest, mut odd_one) = (0.0, 0.0, 0.0, false);
        for (k, i) in self.each(m).enumerate() {
            let (d, error) = self.entry(k, noise[i], 0.0);
            let floor = self.floor(k, noise[i]);
            value = crate::scalar::hypot(value, d * weight[i]);
            random = crate::scalar::hypot(random, floor * weight[i]);
            rest = crate::scalar::hypot(rest, (error - floor).max(0.0) * weight[i]);
            odd_one |= self.irregular(k, noise[i]);
        }
        if rest <= 1e-8 * value || (rest <= random && !odd_one) {
            self.phase = Phase::Done;
            return;
        }
        if !room {
            self.phase = Phase::Done;
            return;
        }
        // Where short steps have all the noise, the longest one wants others beside it.
        for k in 0..2 {
            let share = random * steps[0] / steps[k + 1];
            if steps[k] > 2.5 * steps[k + 1] && !odd_one && rest <= 4.0 * share {
                self.next = 0.5 * steps[k];
                return;
            }
        }
        let shortest = steps[steps.len() - 1];
        if odd_one && self.detail.is_none() && self.pairs.len() + 3 <= self.room {
            // Noise that the table of differences did not show, or detail far finer.
            let next = power((shortest / 1024.0).max(self.least));
            if next < 0.25 * shortest {
                self.phase = Phase::Detail;
                self.next = next;
                return;
            }
        }
        let next = 0.25 * shortest;
        if next < self.least || rest <= 4.0 * random {
            self.phase = Phase::Done;
        } else {
            self.next = next;
        }
    }

    /// Whether the change is proportional to the step, all along the ladder.
    fn lawful(&self, weight: &[f64], noise: &[f64]) -> bool {
        let pairs: Vec<&Pair> = self.used().collect();
        pairs.windows(2).all(|w| {
            let [odd, even, level] = self.sizes(w[1], weight, noise);
            let ratio = w[1].step / w[0].step;
            let off = norm(
                self.each(noise.len())
                    .enumerate()
                    .map(|(k, i)| weight[i] * (w[1].odd[k] - ratio * w[0].odd[k])),
            );
            odd > 10.0 * level && even < BENT * odd && off < 0.1 * odd
        })
    }

    fn compare(&mut self, weight: &[f64], noise: &[f64]) {
        let last = self.pairs.len() - 1;
        let m = noise.len();
        let short: Vec<usize> = (0..=last)
            .filter(|&k| {
                self.pairs[k].finite && self.pairs[k].step <= self.pairs[self.anchor].step / 500.0
            })
            .collect();
        if short.len() < 2 {
            self.next = 0.5 * self.pairs[last].step;
            if self.next < self.least || self.pairs.len() >= self.room {
                self.phase = Phase::Done;
            }
            return;
        }
        self.phase = Phase::Done;
        // The derivative by short steps against that by long ones.
        let (a, b) = (&self.pairs[short[0]], &self.pairs[short[1]]);
        let (mut apart, mut apart_short, mut size) = (0.0, 0.0, 0.0);
        let mut allowed = 0.0;
        for (k, i) in self.each(m).enumerate() {
            let (long, error) = self.entry(k, noise[i], 0.0);
            let (da, db) = (a.odd[k] / a.step, b.odd[k] / b.step);
            apart = crate::scalar::hypot(apart, (da - long) * weight[i]);
            apart_short = crate::scalar::hypot(apart_short, (da - db) * weight[i]);
            allowed = crate::scalar::hypot(allowed, error * weight[i]);
            size = crate::scalar::hypot(size, da * weight[i]);
        }
        if apart > 10.0 * allowed && apart_short < 0.05 * size {
            // Detail: a smooth function where steps are short.
            self.detail = Some(short[0]);
            if self.pairs.len() + 2 <= self.room {
                self.phase = Phase::Ladder;
                self.next = 0.5 * b.step;
            }
        } else {
            // Noise: the short steps only amplify it.
            for k in short {
                self.pairs[k].finite = false;
            }
        }
    }

    /// Whether differences of one output stay where they should fall with the step.
    fn irregular(&self, k: usize, noise: f64) -> bool {
        let pairs: Vec<&Pair> = self.used().collect();
        pairs
            .windows(3)
            .any(|w| irregular(w[0], w[1], w[2], k, noise))
    }

    /// Whether the output was seen to move with the state.
    pub(super) fn moves(&self, k: usize) -> bool {
        let moved = |p: &Pair| p.odd[k] != 0.0 || p.even[k] != 0.0;
        self.pairs.iter().any(moved)
    }

    /// What noise leaves of the best estimate.
    fn floor(&self, k: usize, noise: f64) -> f64 {
        let longest = self.longest();
        let largest = self
            .used()
            .map(|p| p.odd[k].abs().max(p.even[k].abs()))
            .fold(0.0, f64::max);
        COVERAGE * (noise + f64::EPSILON * largest) / longest.max(f64::MIN_POSITIVE)
    }

    /// Derivative and error of one output.
    pub(super) fn entry(&self, k: usize, noise: f64, at: f64) -> (f64, f64) {
        let pairs: Vec<&Pair> = self.used().collect();
        if pairs.is_empty() {
            return (0.0, f64::INFINITY);
        }
        let level =
            |p: &Pair| noise.max(f64::EPSILON * (at.abs() + p.odd[k].abs() + p.even[k].abs()));
        // The shortest step alone: how bent the function is, and what another step gives, as
        // that of an odd function bends where the even part is zero.
        let mut best = {
            let p = pairs[pairs.len() - 1];
            let value = p.odd[k] / p.step;
            let even = p.even[k].abs().min(p.odd[k].abs());
            let apart = match pairs.as_slice() {
                [.., q, _] => (q.odd[k] / q.step - value).abs(),
                _ => value.abs(),
            };
            let error = apart + (even + COVERAGE * level(p)) / p.step;
            (value, error.max(slow(&pairs, k, noise, value)))
        };
        for width in 2..=3.min(pairs.len()) {
            for (start, window) in pairs.windows(width).enumerate() {
                let (value, weights) = extrapolate(window, k);
                let shorter = extrapolate(&window[1..], k).0;
                let mut gap = (value - shorter).abs();
                if let [long, short] = pairs.as_slice() {
                    // No third step tells whether the error falls as the square of the step:
                    // as its root, then.
                    let apart = (long.odd[k] / long.step - short.odd[k] / short.step).abs();
                    gap = gap.max(apart / ((long.step / short.step).sqrt() - 1.0));
                }
                if width == 3 {
                    // The gap is the error of two steps; that of three is smaller as
                    // the gap is smaller than the one before it.
                    let before = (shorter - window[2].odd[k] / window[2].step).abs();
                    let bend = 4.0 * (window[0].even[k] / window[0].odd[k]).powi(2);
                    let fall = if before > 0.0 { gap / before } else { 1.0 };
                    gap *= (10.0 * fall.max(bend)).clamp(1e-3, 1.0);
                    if !gap.is_finite() {
                        continue;
                    }
                }
                let random = norm(
                    window
                        .iter()
                        .zip(&weights)
                        .map(|(p, w)| w * level(p) / p.step),
                ) * core::f64::consts::FRAC_1_SQRT_2;
                let seen = (start + width).max(3).min(pairs.len());
                let error = (gap + COVERAGE * random).max(slow(&pairs[..seen], k, noise, value));
                if error < best.1 && value.is_finite() {
                    best = (value, error);
                }
            }
        }
        if let [.., q, p] = pairs.as_slice()
            && p.odd[k].abs() > 8.0 * level(p)
            && p.odd[k].abs() > q.odd[k].abs() * (p.step / q.step).sqrt()
        {
            // The change hardly falls with the step: what is cut off beside x, or a root at 0.
            best.1 = UNKNOWN;
        }
        // Over many steps that is no noise, which a kink passes for where noise is measured.
        let wide = pairs.len() > 3 && kinked(&pairs, k, 0.0, 16.0);
        if let Some(p) = pairs.last()
            && (wide || kinked(&pairs, k, noise, 4.0))
        {
            // Between the slopes on either side there is no telling.
            let largest = at.abs() + p.odd[k].abs() + p.even[k].abs();
            let rounding = 4.0 * f64::EPSILON * largest;
            best.1 = best.1.max((p.even[k].abs() + rounding) / p.step);
        }
        if self.reach > 0.0 {
            // Unresolved: there may be detail as short as the shortest step.
            let largest = self
                .pairs
                .iter()
                .map(|p| p.odd[k].abs().max(p.even[k].abs()));
            let largest = largest.filter(|x| x.is_finite()).fold(noise, f64::max);
            best.1 = best.1.max(largest / self.reach);
        }
        best
    }
}
