// Every lane has a tile of its own and loads the clusters of the map, the same as all others.

fn enlist_all(group: Group, list: ptr<function, Enlisted>, lane: u32) {
    for (var number = 0u; number < group.slot_count; number++) {
        let slot = slots[group.first_slot + number];
        enlist(list, cluster_at(slot), slot);
    }
}
