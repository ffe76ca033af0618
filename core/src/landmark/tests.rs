//! Both filters on drives whose truth is known: Jacobians, the exact answer, consistency, determinism, full pools.

mod consistency;
mod exact;
mod jacobians;
mod world;

use super::*;

#[test]
fn chi_squared_is_near_its_tables() {
    for (freedoms, deviations, table) in
        [(2, 2.3263, 9.21), (2, 1.6449, 5.991), (4, 2.3263, 13.277), (20, 1.6449, 31.41)]
    {
        let found = chi_squared(freedoms, deviations);
        assert!((found - table).abs() < 0.01 * table, "{freedoms}: {found}, table {table}");
    }
}

#[test]
fn angles_are_wrapped_half_open() {
    assert_eq!((wrap_angle(PI), wrap_angle(-PI)), (PI, PI));
    assert!((wrap_angle(7.0 * PI + 0.25) - (0.25 - PI)).abs() < 1e-12);
    assert!(wrap_angle(f64::INFINITY).is_nan());
}
