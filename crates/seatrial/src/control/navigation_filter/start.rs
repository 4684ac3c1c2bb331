//! How a navigation filter begins, and begins anew where it was lost.
//!
//! Tests: `tests/flight/test_navigation.py`.

use super::fitting::{ATTITUDE_SENSOR, DEPTH, DVL_WATER, GPS, GYRO, POSITION_FIX, USBL};
use super::{Instrument, NavigationFilter, finite};
use crate::control::navigation::{VELOCITY as GROUND, WATER};
use crate::filter::estimate::{ATTITUDE, CURRENT, Estimate, FORCE, GYRO_BIAS, POSITION, STATES, VELOCITY};
use crate::model::kinematics::{from_euler, quaternion_product};
use crate::number::algebra::{product, splat};
use crate::number::plain;
use crate::number::real::Real;

/// Deviations at the start of what was not measured: velocity m/s, rates rad/s.
const AT_START: [f64; 2] = [0.5, 0.1];

impl<T: Real> NavigationFilter<T> {
    /// What is lost begins anew from the next samples.
    #[inline(always)]
    pub(super) fn lose(&mut self, mask: T::Mask) {
        let (zero, one) = (self.begun.zero(), self.begun.splat(1.0));
        self.restarts += T::select(mask, one, zero);
        self.begun = T::select(mask, zero, self.begun);
        for first in &mut self.first {
            *first = T::select(mask, zero.splat(f64::NAN), *first);
        }
    }

    /// Begins where the mask holds and the attitude is known.
    #[inline(always)]
    pub(super) fn try_to_begin(&mut self, mask: T::Mask) {
        let of = |kind: usize| self.fitting.instruments[kind].unwrap_or(Instrument::of(0.0));
        let first = |channel: usize| self.first[channel];
        let zero = self.begun.zero();
        // The last of several that is known.
        let known = |or: T, channel: usize| T::select(finite(first(channel)), first(channel), or);
        let angles = [first(3), first(4), first(5)];
        let ready = T::both(T::both(finite(angles[0]), finite(angles[1])), T::both(finite(angles[2]), mask));
        if !T::any(ready) {
            return;
        }
        let (mut at, mut deviations) = (Estimate::at_rest_in(zero), [zero; STATES]);
        let [w, x, y, z] = splat(zero, &of(ATTITUDE_SENSOR).mount);
        at.motion.attitude = quaternion_product(&from_euler(&angles), &[w, -x, -y, -z]);
        let spread = |kind: usize| plain::hypot(of(kind).noise, of(kind).bias).max(1e-6);
        let (start, far) = self.fitting.start;
        let turned = at.rotation();
        for i in 0..3 {
            deviations[ATTITUDE + i] = zero.splat(spread(ATTITUDE_SENSOR));
            // The place of the launch, as whoever launches tells it.
            let mut place = known(zero.splat(start[i]), i);
            let mut deviation = zero.splat(far);
            let fixes: &[(usize, usize)] = match i {
                2 => &[(20, USBL), (2, DEPTH)],
                _ => &[(18, USBL), (16, GPS), (0, POSITION_FIX)],
            };
            for &(channel, kind) in fixes {
                if self.fitting.instruments[kind].is_some() {
                    let fix = first(channel + if i < 2 { i } else { 0 });
                    let arm = product(&turned, &splat(zero, &of(kind).arm));
                    place = T::select(finite(fix), fix - arm[i], place);
                    deviation = T::select(finite(fix), zero.splat(spread(kind)), deviation);
                }
            }
            (at.motion.position[i], deviations[POSITION + i]) = (place, deviation);
            deviations[VELOCITY + i] = zero.splat(AT_START[0]);
            deviations[VELOCITY + 3 + i] = zero.splat(AT_START[1]);
            let through = self.fitting.instruments[DVL_WATER].is_some();
            at.motion.nu[i] = known(zero, if through { WATER + i } else { GROUND + i });
            at.motion.nu[3 + i] = known(zero, 9 + i);
            deviations[CURRENT + i] = zero.splat(self.fitting.noise.current[i]);
            deviations[GYRO_BIAS + i] = zero.splat(of(GYRO).bias);
        }
        // An offset of the attitude turns weight against buoyancy: a lasting moment that the vehicle does not feel.
        let leaning = of(ATTITUDE_SENSOR).bias * self.righting;
        for i in 0..6 {
            let force = self.fitting.noise.force[i];
            let leaned = if i == 3 || i == 4 { plain::hypot(force, leaning) } else { force };
            deviations[FORCE + i] = zero.splat(leaned);
        }
        self.tracker.begin_where(ready, &at, &deviations);
        self.begun = T::select(ready, zero.splat(1.0), self.begun);
    }
}
