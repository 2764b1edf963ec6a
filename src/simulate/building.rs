//! The built-in building: one floor of 40 m by 30 m, and a tour of about 260 m through it.
//!
//! A ring of corridors, 87 m around, is cut in two by a cross corridor. Offices lie outside the ring and meeting rooms
//! inside; a hall with pillars opens to two corridors and a lounge in the east has a curved front.

use super::plan::{Door, Plan};
use std::f64::consts::{FRAC_PI_2, PI};

/// Draws the building.
pub fn building() -> Plan {
    let mut plan = Plan::default();
    outside(&mut plan);
    offices(&mut plan);
    west_core(&mut plan);
    east_core(&mut plan);
    furnish(&mut plan);
    tour(&mut plan);
    plan
}

fn outside(plan: &mut Plan) {
    plan.partition([0.0, 0.0], [40.0, 0.0], &[]);
    plan.partition([0.0, 0.0], [0.0, 30.0], &[]);
    plan.partition([0.0, 30.0], [40.0, 30.0], &[]);
    plan.partition([40.0, 0.0], [40.0, 8.5], &[]);
    plan.partition([40.0, 21.5], [40.0, 30.0], &[]);
    // The front of the lounge: the circle through (40, 8.5), (42.5, 15) and (40, 21.5).
    let (radius, half) = (9.7, (6.5f64 / 9.7).asin());
    plan.bent_partition([32.8, 15.0], radius, -half, half);
}

fn offices(plan: &mut Plan) {
    let south = [(8.3, -50.0), (10.2, 0.0), (16.5, -95.0), (18.6, -80.0), (25.0, 0.0), (27.0, -30.0), (33.0, -100.0)];
    let north = [(6.8, 0.0), (11.4, 45.0), (15.6, 100.0), (21.0, 60.0), (25.0, 0.0), (29.6, 75.0)];
    plan.partition([0.0, 5.4], [40.0, 5.4], &south.map(|(x, angle)| Door::leaf(x, angle)));
    plan.partition([0.0, 24.6], [40.0, 24.6], &north.map(|(x, angle)| Door::leaf(x, angle)));
    let west = [(7.5, 90.0), (12.0, 0.0), (17.0, 50.0), (22.0, 80.0)];
    plan.partition([5.0, 5.4], [5.0, 24.6], &west.map(|(y, angle)| Door::leaf(y - 5.4, angle)));
    // The lounge is open to the corridor between y = 12.5 and 17.5.
    let east = [Door::leaf(1.8, -40.0), Door::opening(9.6, 5.0), Door::leaf(17.6, 0.0)];
    plan.partition([34.0, 5.4], [34.0, 24.6], &east);

    for x in [9.2, 13.0, 17.5, 22.0, 26.0, 30.4] {
        plan.partition([x, 0.0], [x, 5.4], &[]);
    }
    for x in [6.0, 10.5, 14.5, 20.0, 24.0, 28.5] {
        plan.partition([x, 24.6], [x, 30.0], &[]);
    }
    // The corner rooms are entered through their neighbours.
    plan.partition([5.0, 0.0], [5.0, 5.4], &[Door::leaf(4.0, 70.0)]);
    plan.partition([34.0, 0.0], [34.0, 5.4], &[Door::leaf(4.2, -60.0)]);
    plan.partition([34.0, 24.6], [34.0, 30.0], &[Door::leaf(1.5, -60.0)]);
    for y in [10.0, 14.2, 19.0] {
        plan.partition([0.0, y], [5.0, y], &[]);
    }
    plan.partition([34.0, 8.5], [40.0, 8.5], &[]);
    plan.partition([34.0, 21.5], [40.0, 21.5], &[]);
}

fn west_core(plan: &mut Plan) {
    plan.partition([7.4, 7.8], [18.5, 7.8], &[Door::leaf(3.6, 60.0)]);
    plan.partition([7.4, 7.8], [7.4, 19.7], &[]);
    plan.bent_partition([9.9, 19.7], 2.5, FRAC_PI_2, PI);
    plan.partition([9.9, 22.2], [18.5, 22.2], &[Door::leaf(4.1, -30.0)]);
    plan.partition([18.5, 7.8], [18.5, 22.2], &[Door::leaf(3.2, 100.0), Door::leaf(10.2, 95.0)]);
    plan.partition([7.4, 15.0], [18.5, 15.0], &[]);
    plan.partition([13.0, 7.8], [13.0, 15.0], &[]);
}

fn east_core(plan: &mut Plan) {
    plan.partition([20.9, 7.8], [31.6, 7.8], &[]);
    plan.partition([20.9, 22.2], [31.6, 22.2], &[Door::leaf(8.1, -80.0)]);
    plan.partition([20.9, 7.8], [20.9, 22.2], &[Door::opening(3.4, 4.0), Door::leaf(11.7, -45.0)]);
    plan.partition([31.6, 7.8], [31.6, 22.2], &[Door::opening(3.0, 1.8), Door::leaf(10.7, 60.0)]);
    // The hall's far wall stands askew.
    plan.partition([20.9, 14.0], [31.6, 16.5], &[]);
    plan.partition([26.2, 15.24], [26.2, 22.2], &[]);
    plan.shaft([22.0, 16.0], [24.4, 18.2]);
    for pillar in [[23.5, 9.6], [23.5, 12.6], [28.2, 9.4], [28.2, 13.0], [34.0, 15.0]] {
        plan.round(pillar, 0.25);
    }
}

fn furnish(plan: &mut Plan) {
    let desks = [
        ([9.4, 0.1], [11.0, 0.9]),
        ([13.2, 0.1], [14.8, 0.9]),
        ([15.9, 0.1], [17.3, 0.9]),
        ([20.2, 0.1], [21.8, 0.9]),
        ([22.2, 0.6], [23.0, 2.2]),
        ([26.2, 1.0], [27.0, 2.6]),
        ([30.6, 0.1], [32.2, 0.9]),
        ([36.0, 2.0], [37.6, 2.8]),
        ([6.2, 29.0], [7.8, 29.9]),
        ([10.7, 29.0], [12.3, 29.9]),
        ([14.7, 29.1], [16.3, 29.9]),
        ([17.6, 27.2], [18.4, 28.8]),
        ([20.2, 29.1], [21.8, 29.9]),
        ([24.2, 28.0], [25.0, 29.6]),
        ([30.0, 29.1], [31.6, 29.9]),
        ([0.1, 6.0], [0.9, 7.6]),
        ([0.1, 11.0], [0.9, 12.6]),
        ([0.1, 15.5], [0.9, 17.1]),
        ([0.1, 20.5], [0.9, 22.1]),
        ([0.8, 1.5], [1.6, 3.1]),
    ];
    let shelves = [
        ([12.5, 1.5], [12.9, 4.0]),
        ([17.6, 1.0], [18.0, 3.4]),
        ([33.5, 1.2], [33.9, 3.2]),
        ([19.5, 25.6], [19.9, 28.0]),
        ([13.3, 14.4], [17.5, 14.9]),
        ([7.5, 9.0], [7.9, 13.0]),
        ([29.0, 21.7], [31.0, 22.1]),
    ];
    // A cupboard, a copier and a bench stand in the corridors.
    let in_corridors = [([21.5, 5.48], [23.2, 5.9]), ([17.5, 22.28], [18.4, 22.85]), ([5.08, 14.6], [5.5, 15.9])];
    // The long table of the seminar room, the meeting table, the lounge's sofas.
    let tables = [
        ([9.6, 18.0], [14.0, 19.3]),
        ([9.2, 10.6], [11.2, 11.8]),
        ([38.8, 10.4], [39.6, 12.6]),
        ([36.6, 9.0], [38.6, 9.8]),
    ];
    for &(lower, upper) in desks.iter().chain(&shelves).chain(&in_corridors).chain(&tables) {
        plan.furniture(lower, upper);
    }
    let chairs = [
        [10.2, 17.5],
        [11.4, 17.6],
        [12.6, 17.4],
        [10.4, 19.8],
        [11.8, 19.7],
        [13.2, 19.8],
        [14.5, 18.7],
        [13.9, 1.4],
        [16.5, 1.4],
        [15.5, 28.6],
        [10.2, 12.2],
    ];
    chairs.iter().for_each(|&chair| plan.round(chair, 0.2));
    for plant in [[33.6, 24.2], [5.35, 5.75], [39.6, 19.4], [31.2, 14.4]] {
        plan.round(plant, 0.22);
    }
    plan.round([39.4, 16.0], 0.5);
}

fn tour(plan: &mut Plan) {
    // Around the ring, into an office, through the lounge, and into another office.
    plan.go(&[
        [9.5, 6.6],
        [16.5, 6.6],
        [16.5, 3.0],
        [16.5, 6.6],
        [32.8, 6.6],
        [32.8, 13.7],
        [37.5, 13.7],
        [37.5, 16.3],
    ]);
    plan.go(&[[32.8, 16.3], [32.8, 23.4], [15.6, 23.4], [15.6, 26.8], [15.6, 23.4], [6.2, 23.4], [6.2, 6.6]]);
    // By the cross corridor and the hall to the east side, back and into the seminar room.
    plan.go(&[[19.7, 6.6], [19.7, 11.1], [25.8, 11.1], [30.0, 10.8], [32.8, 10.8], [32.8, 23.4], [19.7, 23.4]]);
    plan.go(&[[19.7, 18.0], [16.4, 18.0], [19.7, 18.0], [19.7, 6.6]]);
    // Around the western half the other way, and home.
    plan.go(&[[6.2, 6.6], [6.2, 23.4], [19.7, 23.4], [19.7, 6.6], [9.5, 6.6]]);
}
