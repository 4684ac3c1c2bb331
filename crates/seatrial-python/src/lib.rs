//! The Python face of the core: whole objects from files in, arrays out. No physics here.

use pyo3::prelude::*;

mod ardusub;
mod ardusub_flight;
mod autopilot;
mod closed_loop;
mod convert;
mod error;
mod export;
mod identify;
mod linear_model;
mod log_store;
mod mission;
mod motor;
mod navigation_filter;
mod pickle;
mod run;
mod simulate;
mod text;
mod trial;
mod vehicle;
mod work;

/// The compiled core of seatrial.
#[pymodule(gil_used = false)]
mod _core {
    #[pymodule_export]
    use crate::ardusub::{
        ardusub_forward_lateral, ardusub_frames, ardusub_pulses, ardusub_rates, ardusub_square_root,
        ardusub_terms, ardusub_velocity,
    };
    #[pymodule_export]
    use crate::ardusub_flight::{ardusub_defaults, ardusub_fly};
    #[pymodule_export]
    use crate::autopilot::{Autopilot, Helm, autopilot_names, restored_autopilot};
    #[pymodule_export]
    use crate::closed_loop::{Flights, error_edges, fly, restored_flights};
    #[pymodule_export]
    use crate::export::{autopilot_c, filter_c, vehicle_c};
    #[pymodule_export]
    use crate::identify::{OpenLoop, Record, all_nuisance_names, initial_names};
    #[pymodule_export]
    use crate::linear_model::LinearModel;
    #[pymodule_export]
    use crate::mission::{Mission, restored_mission};
    #[pymodule_export]
    use crate::motor::motor_response;
    #[pymodule_export]
    use crate::navigation_filter::Filter;
    #[pymodule_export]
    use crate::run::{Run, State, restored_run, restored_state};
    #[pymodule_export]
    use crate::simulate::{simd_level, simulate_batch};
    #[pymodule_export]
    use crate::text::{file_kind, file_text_for_python, wrong_kind};
    #[pymodule_export]
    use crate::vehicle::{Vehicle, restored_vehicle};
    #[pymodule_export]
    use crate::work::checked_threads;
}
