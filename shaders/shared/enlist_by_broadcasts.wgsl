// Every lane has a tile of its own; eight lanes load four clusters of the map and broadcast them.

fn enlist_all(group: Group, list: ptr<function, Enlisted>, lane: u32) {
    for (var first = 0u; first < group.slot_count; first += 4u) {
        let left = group.slot_count - first;
        let slot = slots[group.first_slot + first + min(lane % 4u, left - 1u)];
        let mine = half_of(slot, lane);
        enlist(list, broadcast0(mine), subgroupBroadcast(slot, 0u));
        if left > 1u {
            enlist(list, broadcast1(mine), subgroupBroadcast(slot, 1u));
        }
        if left > 2u {
            enlist(list, broadcast2(mine), subgroupBroadcast(slot, 2u));
        }
        if left > 3u {
            enlist(list, broadcast3(mine), subgroupBroadcast(slot, 3u));
        }
    }
}
