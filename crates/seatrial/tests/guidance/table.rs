//! The table and its tunable numbers.

use seatrial::control::guidance::{Guidance, GuidanceTable, Method, TUNABLE};

#[test]
fn law_table_reads_its_own_keys_and_refuses_others() {
    let table: GuidanceTable = toml::from_str("method = \"lookahead\"\nlookahead_m = 7.5").unwrap();
    assert_eq!(
        table,
        GuidanceTable { method: Method::Lookahead, lookahead_m: 7.5, ..GuidanceTable::default() }
    );
    assert!(toml::from_str::<GuidanceTable>("lookahead = 7.5").is_err());
    let again: GuidanceTable = toml::from_str(&toml::to_string(&table).unwrap()).unwrap();
    assert_eq!(again, table);
}

#[test]
fn law_table_names_its_tunable_numbers_in_order() {
    let mut table = GuidanceTable::default();
    let values: [f64; TUNABLE.len()] = std::array::from_fn(|i| 1.5 + i as f64);
    table.set_tunable(&values);
    assert_eq!(table.tunable(), values);
    let written = toml::Value::try_from(table).unwrap();
    for (name, value) in TUNABLE.iter().zip(values) {
        assert_eq!(written[name].as_float(), Some(value), "{name}");
    }
}

#[test]
fn law_table_and_tuning_give_the_same_constants() {
    let mut table = GuidanceTable::default();
    let values: [f64; TUNABLE.len()] = std::array::from_fn(|i| 1.5 + i as f64);
    let mut tuned = Guidance::new(&table, 0.0, true, true);
    tuned.tune(&values);
    table.set_tunable(&values);
    assert_eq!(format!("{tuned:?}"), format!("{:?}", Guidance::new(&table, 0.0, true, true)));
    // A pitch of 5.5 degrees: angles are typed in degrees and kept in radians.
    assert!((tuned.pitch_max - 5.5_f64.to_radians()).abs() < 1e-15);
}

#[test]
fn law_table_complains_about_each_number() {
    assert_eq!(GuidanceTable::default().complaint(), None);
    for (i, name) in TUNABLE.iter().enumerate() {
        for wrong in [-1.0, f64::NAN, f64::INFINITY] {
            let mut values = GuidanceTable::default().tunable();
            values[i] = wrong;
            let mut table = GuidanceTable::default();
            table.set_tunable(&values);
            let complaint = table.complaint().unwrap();
            assert!(complaint.starts_with(&format!("{name}: expected")), "{complaint}");
        }
    }
    for table in [
        GuidanceTable { pitch_max_deg: 90.0, ..GuidanceTable::default() },
        GuidanceTable { lookahead_m: 0.0, ..GuidanceTable::default() },
        GuidanceTable { turn_speed_share: 1.1, ..GuidanceTable::default() },
        GuidanceTable { watch_radius_m: 1.0, ..GuidanceTable::default() },
    ] {
        assert!(table.complaint().is_some(), "{table:?}");
    }
}
