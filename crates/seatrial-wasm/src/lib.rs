//! The core behind an interface of plain numbers and text: what flies inside the page of a report.
//!
//! A caller asks [`input`] for room, writes a request there as TOML in UTF-8, and calls [`fly`], [`mission`],
//! [`autopilot`] or [`moved`]. These return 0, or 1 with a message in the text. Results stand at [`numbers`] and
//! [`text`] until the next call. Nothing is kept between calls: the same request gives the same result.
//!
//! Tests: `tests/report/test_page_in_browser.py` (equal to `seatrial.fly`).

mod request;

use std::cell::RefCell;

thread_local! {
    static STORE: RefCell<Store> = const { RefCell::new(Store { input: Vec::new(), numbers: Vec::new(), text: String::new() }) };
}

/// What passes between the page and the core.
struct Store {
    input: Vec<u8>,
    numbers: Vec<f64>,
    text: String,
}

/// Numbers and text, or what is wrong.
type Answer = Result<(Vec<f64>, String), String>;

/// Room for a request of so many bytes: where to write it.
#[allow(unsafe_code, reason = "an export by name")]
#[unsafe(no_mangle)]
pub extern "C" fn input(bytes: usize) -> *const u8 {
    STORE.with_borrow_mut(|store| {
        store.input.clear();
        store.input.resize(bytes, 0);
        store.input.as_ptr()
    })
}

/// Where the numbers of the last result are.
#[allow(unsafe_code, reason = "an export by name")]
#[unsafe(no_mangle)]
pub extern "C" fn numbers() -> *const f64 {
    STORE.with_borrow(|store| store.numbers.as_ptr())
}

/// How many numbers there are.
#[allow(unsafe_code, reason = "an export by name")]
#[unsafe(no_mangle)]
pub extern "C" fn numbers_length() -> usize {
    STORE.with_borrow(|store| store.numbers.len())
}

/// Where the text of the last result is.
#[allow(unsafe_code, reason = "an export by name")]
#[unsafe(no_mangle)]
pub extern "C" fn text() -> *const u8 {
    STORE.with_borrow(|store| store.text.as_ptr())
}

/// How many bytes it has.
#[allow(unsafe_code, reason = "an export by name")]
#[unsafe(no_mangle)]
pub extern "C" fn text_length() -> usize {
    STORE.with_borrow(|store| store.text.len())
}

/// Flies one case. Numbers: the figures, waypoints reached and there, then the log by rows; text: the names of the figures in a line, those of the
/// log's columns in the next.
#[allow(unsafe_code, reason = "an export by name")]
#[unsafe(no_mangle)]
pub extern "C" fn fly() -> u32 {
    answered(request::fly)
}

/// What a mission means. Numbers: start (north, east, depth, heading), length, planned time, longest time, count of
/// waypoints and, of each, north, east, depth or altitude, acceptance radius; text: the labels, a line each.
#[allow(unsafe_code, reason = "an export by name")]
#[unsafe(no_mangle)]
pub extern "C" fn mission() -> u32 {
    answered(request::mission)
}

/// The autopilot file with other gains. Numbers: none; text: the file.
#[allow(unsafe_code, reason = "an export by name")]
#[unsafe(no_mangle)]
pub extern "C" fn autopilot() -> u32 {
    answered(request::autopilot)
}

/// The mission file with a waypoint elsewhere. Numbers: none; text: the file.
#[allow(unsafe_code, reason = "an export by name")]
#[unsafe(no_mangle)]
pub extern "C" fn moved() -> u32 {
    answered(request::moved)
}

/// The vehicle file with other coefficients. Numbers: none; text: the file.
#[allow(unsafe_code, reason = "an export by name")]
#[unsafe(no_mangle)]
pub extern "C" fn vehicle() -> u32 {
    answered(request::vehicle)
}

/// Keeps the answer to the request that was written.
fn answered(answer: fn(&str) -> Answer) -> u32 {
    let input = STORE.with_borrow_mut(|store| std::mem::take(&mut store.input));
    let given = String::from_utf8(input).map_err(|_| "request: expected UTF-8".to_owned());
    let (numbers, text, status) = match given.and_then(|text| answer(&text)) {
        Ok((numbers, text)) => (numbers, text, 0),
        Err(message) => (Vec::new(), message, 1),
    };
    STORE.with_borrow_mut(|store| (store.numbers, store.text) = (numbers, text));
    status
}
