//! The table [allocation] is checked against the vehicle, with messages that help.

use crate::vehicles::{hull, load};
use seatrial::control::allocation::{AllocationTable, Allocator, Method};
use seatrial::model::vehicle::Vehicle;

fn complaint(table: &str) -> String {
    let description = load("cwolf");
    let table: AllocationTable = match toml::from_str(table) {
        Ok(table) => table,
        Err(error) => return error.to_string(),
    };
    match Allocator::single(&description, &Vehicle::nominal(&description), &table) {
        Ok(_) => String::new(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn a_table_that_fits_is_taken() {
    let text = r#"
        method = "quadratic"
        weights = { stern = 1.0, VTB = 2.0 }
        priority = { X = 1.0, N = 5.0 }
        start_share = 0.9
        stop_share = 0.4
        idle = { vertical = 200.0 }
        redistribution_passes = 1
        fin_least_speed_m_s = 0.2
        fin_inflow = false
    "#;
    assert_eq!(complaint(text), "");
    let table: AllocationTable = toml::from_str(text).unwrap();
    assert_eq!(table.method, Method::Quadratic);
    let again: AllocationTable = toml::from_str(&toml::to_string(&table).unwrap()).unwrap();
    assert_eq!(table, again);
}

#[test]
fn a_table_that_does_not_fit_is_refused() {
    for (table, parts) in [
        ("method = \"inverse\"", vec!["unknown variant", "pseudo-inverse"]),
        ("wieghts = {}", vec!["unknown field", "weights"]),
        ("weights = { stren = 2.0 }", vec!["allocation.weights", "stren", "did you mean \"stern\""]),
        ("weights = { stern = 0.0 }", vec!["weights.stern", "positive", "found 0"]),
        ("priority = { x = 2.0 }", vec!["priority", "X Y Z K M N", "did you mean \"X\""]),
        ("priority = { X = 0.0 }", vec!["priority.X", "0.001", "found 0"]),
        ("start_share = 12.0", vec!["start_share", "0 to 10", "12"]),
        ("stop_share = 1.0\nstart_share = 0.8", vec!["stop_share", "start_share", "found 1"]),
        ("fin_least_speed_m_s = -1.0", vec!["fin_least_speed_m_s", "-1"]),
        ("idle = { VTB = 20.0 }", vec!["idle", "VTB", "150", "2000", "rpm", "found 20"]),
    ] {
        let message = complaint(table);
        for part in parts {
            assert!(message.contains(part), "{table}: expected {part:?} in {message:?}");
        }
    }
}

#[test]
fn what_cannot_be_allocated_is_refused() {
    let description = load("cwolf");
    let quadratic = AllocationTable { method: Method::Quadratic, ..AllocationTable::default() };
    let refused = Allocator::new(&description, &Vehicle::nominal(&description), &quadratic);
    assert!(refused.err().unwrap().to_string().contains("pseudo-inverse"));
    let bare = hull(&[("m", 10.0), ("I_x", 1.0), ("I_y", 1.0), ("I_z", 1.0)].map(|(n, x)| (n.to_owned(), x)));
    let refused = Allocator::new(&bare, &Vehicle::nominal(&bare), &AllocationTable::default());
    assert!(refused.err().unwrap().to_string().contains("no actuators"));
}
