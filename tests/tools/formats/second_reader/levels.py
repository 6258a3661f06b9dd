"""Which level of detail of each object is read. The rules are those of docs/inputs.md: the best level of each object, no
footprint below a building, and no coarser building below its parts."""


def choose(best, parents, is_part):
    """Names of the objects that are left out.

    `best` has the highest level of each object that has a geometry, `parents` the names of its parents, and `is_part` tells
    whether it is a part and not an addition such as a chimney.
    """
    out = set()
    for name in best:
        for above in ancestors(name, parents):
            if above not in best:
                continue
            if best[above] < best[name] and (best[above] < 1 or is_part(name)):
                out.add(above)
            elif best[name] < best[above] and best[name] < 1:
                out.add(name)
    return out


def ancestors(name, parents):
    found, waiting = [], list(parents.get(name, []))
    while waiting:
        above = waiting.pop()
        if above != name and above not in found:
            found.append(above)
            waiting += parents.get(above, [])
    return found
