//! What a ray has gathered on its way from the eye.

/// Below this transmittance a ray may end, and a share of its radiance below this is nothing.
const NEGLIGIBLE: f64 = 1e-9;

/// A ray's sums, front to back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RayState {
    /// Radiance that reaches the eye so far: linear R, G, B.
    pub radiance: [f64; 3],
    /// The share of light from behind that still reaches the eye.
    pub transmittance: f64,
    /// Depths (code length along the view from the eye) from which on the transmittance is below
    /// ¼, ¹⁄₁₆, …, rounded up: what is known of the way behind when bricks beside it are met later.
    marks: [f32; MARKS],
    /// What rounding has added to each channel's sum, to be taken off with the next (Kahan, *CACM*
    /// 8, 1965): thin steps neither drift nor vanish.
    pub(super) radiance_excess: [f64; 3],
    /// What rounding has added to the transmittance, to be taken off likewise: thin steps do not
    /// vanish beside 1.
    pub(crate) transmittance_excess: f64,
}

const MARKS: usize = 8;
const MARK_FACTOR: f64 = 0.25;

impl Default for RayState {
    fn default() -> Self {
        Self {
            radiance: [0.0; 3],
            transmittance: 1.0,
            marks: [f32::INFINITY; MARKS],
            radiance_excess: [0.0; 3],
            transmittance_excess: 0.0,
        }
    }
}

impl RayState {
    /// Whether what lies behind may be left out.
    #[inline]
    pub(crate) fn is_done(&self, ending: &Ending) -> bool {
        if self.transmittance > ending.transmittance {
            return false;
        }
        let largest = self.radiance[0].max(self.radiance[1]).max(self.radiance[2]);
        let behind = self.transmittance * ending.brightest;
        let nothing = self.transmittance < NEGLIGIBLE && behind <= NEGLIGIBLE * largest;
        nothing || behind.max(self.transmittance) <= ending.allowed || self.transmittance == 0.0
    }

    /// The ray has come to `depth`.
    #[inline]
    pub(super) fn mark(&mut self, depth: f64) {
        let mut threshold = MARK_FACTOR;
        for mark in &mut self.marks {
            if self.transmittance >= threshold {
                return;
            }
            *mark = mark.min((depth as f32).next_up());
            threshold *= MARK_FACTOR;
        }
    }

    /// An upper bound of the transmittance at `depth` and beyond.
    pub(super) fn transmittance_at(&self, depth: f64) -> f64 {
        let passed = self.marks.iter().take_while(|mark| f64::from(**mark) <= depth).count();
        MARK_FACTOR.powi(i32::try_from(passed).unwrap_or(0))
    }

    /// The largest channel of the light gathered.
    #[cfg(test)]
    pub(crate) fn light(&self) -> f64 {
        self.radiance[0].max(self.radiance[1]).max(self.radiance[2])
    }

    /// Light that passes through a stretch of constant `extinction` and `emission` (1 / code
    /// length) over `length` code lengths: the closed form, to rounding for thin and thick.
    /// Returns ∫ T ds.
    #[inline]
    pub(super) fn pass(&mut self, extinction: f64, emission: [f64; 3], length: f64) -> f64 {
        let depth = extinction * length;
        let lit = self.transmittance * length * mean_transmittance(depth);
        self.gather(emission.map(|emission| lit * emission));
        self.absorb(depth);
        lit
    }

    /// Adds light that reaches the eye.
    #[inline]
    pub(super) fn gather(&mut self, light: [f64; 3]) {
        let sums = self.radiance.iter_mut().zip(&mut self.radiance_excess);
        for ((sum, excess), light) in sums.zip(light) {
            add(sum, excess, light);
        }
    }

    /// Passes an optical depth.
    #[inline]
    pub(crate) fn absorb(&mut self, depth: f64) {
        if depth == 0.0 {
            return;
        }
        if depth < SERIES_DEPTH {
            let absorbed = self.transmittance * (depth * mean_series(depth));
            add(&mut self.transmittance, &mut self.transmittance_excess, -absorbed);
        } else {
            let through = (-depth).exp();
            self.transmittance *= through;
            self.transmittance_excess *= through;
        }
    }

    /// At a brick's front, where light that comes from behind is so much `transmittance` of it.
    pub(crate) fn behind(transmittance: f64) -> Self {
        let mut state = Self { transmittance, ..Self::default() };
        state.mark(f64::NEG_INFINITY);
        state
    }

    /// Adds what others have gathered in a brick with a transmittance of 1 in front of it: light
    /// (R, G, B), and the shares of that from behind that they let through and have absorbed, of
    /// which each is exact where it is small.
    pub(crate) fn take(&mut self, [r, g, b, through, absorbed]: [f64; 5]) {
        self.gather([r, g, b].map(|light| light * self.transmittance));
        if absorbed < 0.5 {
            let absorbed = self.transmittance * absorbed;
            add(&mut self.transmittance, &mut self.transmittance_excess, -absorbed);
        } else {
            self.transmittance *= through;
            self.transmittance_excess *= through;
        }
    }

    /// 1 − transmittance, as exact where that is 10⁻³⁰ as elsewhere.
    #[inline]
    pub(crate) fn opacity(&self) -> f64 {
        (1.0 - self.transmittance) + self.transmittance_excess
    }
}

/// `sum` + `value`, and what rounding adds to it.
#[inline]
fn add(sum: &mut f64, excess: &mut f64, value: f64) {
    let value = value - *excess;
    let next = *sum + value;
    *excess = (next - *sum) - value;
    *sum = next;
}

/// Optical depths below this are summed as series, exact to 1e-15.
pub(super) const SERIES_DEPTH: f64 = 0.0625;

/// (1 − e^−depth) / depth: the mean transmittance of a stretch, 1 at depth 0.
#[inline]
pub(super) fn mean_transmittance(depth: f64) -> f64 {
    if depth < SERIES_DEPTH { mean_series(depth) } else { -(-depth).exp_m1() / depth }
}

/// [`mean_transmittance`] up to [`SERIES_DEPTH`].
#[inline]
pub(super) fn mean_series(depth: f64) -> f64 {
    const TERMS: [f64; 8] = [
        1.0,
        -1.0 / 2.0,
        1.0 / 6.0,
        -1.0 / 24.0,
        1.0 / 120.0,
        -1.0 / 720.0,
        1.0 / 5040.0,
        -1.0 / 40320.0,
    ];
    // Pairs, and pairs of pairs (Estrin, 1960): they do not wait for each other.
    let square = depth * depth;
    let pair = |n: usize| TERMS[n] + TERMS[n + 1] * depth;
    (pair(0) + pair(2) * square) + (pair(4) + pair(6) * square) * (square * square)
}

/// Where a ray may end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ending {
    /// Most light that can come from behind any place, before it is absorbed.
    pub brightest: f64,
    /// How much of light and opacity may be lost, in the picture's own unit.
    pub allowed: f64,
    /// No ray ends with more transmittance than this.
    pub transmittance: f64,
}

impl Ending {
    /// An end where at most `allowed` is lost; 0: where no f32 shows it.
    pub(crate) fn new(brightest: f64, allowed: f64) -> Self {
        let transmittance = NEGLIGIBLE.max(allowed / brightest.max(1.0));
        Self { brightest, allowed, transmittance }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thin_and_thick_stretches() {
        let mut thin = RayState::default();
        thin.pass(1e-12, [1.0, 0.0, 2.0], 1.0);
        assert!((thin.radiance[2] - 2.0 * (1.0 - 5e-13)).abs() < 1e-15);
        assert!((1.0 - thin.transmittance - 1e-12).abs() < 1.2e-16);
        let mut thick = RayState::default();
        thick.pass(1e6, [3e6, 0.0, 0.0], 1.0);
        assert!((thick.radiance[0] - 3.0).abs() < 1e-12 && thick.transmittance == 0.0);
        let mut opaque = RayState::default();
        opaque.pass(1e30, [1e30; 3], 1e20);
        assert!((opaque.radiance[0] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn both_formulas_meet() {
        for depth in [0.0_f64, 1e-9, 0.01, 0.0624, 0.0626, 1.0, 40.0] {
            let exact = if depth == 0.0 { 1.0 } else { -(-depth).exp_m1() / depth };
            assert!((mean_transmittance(depth) - exact).abs() < 2e-15, "{depth}");
        }
    }

    #[test]
    fn a_ray_is_done_only_when_nothing_bright_can_follow() {
        let state =
            RayState { radiance: [1.0, 0.0, 0.0], transmittance: 1e-12, ..RayState::default() };
        assert!(state.is_done(&Ending::new(10.0, 0.0)));
        assert!(!state.is_done(&Ending::new(1e10, 0.0)));
        assert!(!RayState { transmittance: 1e-8, ..state }.is_done(&Ending::new(0.0, 0.0)));
    }

    #[test]
    fn a_ray_may_end_where_little_can_follow() {
        let state = RayState { transmittance: 1e-3, ..RayState::default() };
        assert!(state.is_done(&Ending::new(2.0, 2e-3)));
        assert!(!state.is_done(&Ending::new(2.0, 1.9e-3)), "light");
        assert!(!state.is_done(&Ending::new(0.0, 0.9e-3)), "opacity");
        assert!(!state.is_done(&Ending::new(f64::INFINITY, 1.0)));
    }
}
