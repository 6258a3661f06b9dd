"""Subtree tile (docs/formats.md, "Subtree tile")."""
import math
from .container import BadTile, Bytes

MAX_NODES = 1365


def read_subtree(tile_id, sections):
    nodes = read_nodes(tile_id, Bytes(sections.get(1, b"")))
    if 2 in sections:
        read_meshes(nodes, Bytes(sections[2]))
    if 3 in sections:
        read_deviations(nodes, Bytes(sections[3]))
    return {"kind": "subtree", "root": "/".join(map(str, tile_id)), "nodes": nodes}


def read_nodes(root, reader):
    """Section 1: nodes, breadth-first. The ids follow from the child masks."""
    nodes, ids = [], [root]
    for level, x, y in ids:
        mask = reader.one("B")
        z_min, z_max, error, radius = (reader.one("f") for _ in range(4))
        if mask > 15 or not all(map(math.isfinite, (z_min, z_max, error, radius))):
            raise BadTile("a node has an impossible child mask or a number that is not finite")
        if z_max < z_min or error < 0 or radius < 0 or len(ids) > MAX_NODES:
            raise BadTile("a node's bounds or the number of nodes are impossible")
        nodes.append({
            "id": f"{level}/{x}/{y}", "child_mask": mask, "z_min_m": z_min, "z_max_m": z_max, "error_m": error,
            "radius_m": radius, "blockmap_bytes": reader.one("I"),
        })
        if level < root[0] + 5:
            ids += [(level + 1, 2 * x + (q & 1), 2 * y + (q >> 1)) for q in range(4) if mask >> q & 1]
    reader.finish()
    return nodes


def read_meshes(nodes, reader):
    """Section 2: the levels of detail of all nodes, value by value."""
    lods = []
    for node in nodes:
        count = reader.one("B")
        if count > 4 or count and node["child_mask"]:
            raise BadTile("a node has too many levels of detail or is not a leaf")
        if count:
            node["meshes"] = [{} for _ in range(count)]
            lods += node["meshes"]
    for lod in lods:
        lod["error_m"] = reader.one("f")
    for name, low, high in [("bytes", 1, math.inf), ("triangles", 1, 262144), ("texture_px", 0, 4194304)]:
        for lod in lods:
            lod[name] = reader.leb128()
            if not low <= lod[name] <= high:
                raise BadTile(f"{name} of a level of detail is out of range")
    reader.finish()


def read_deviations(nodes, reader):
    """Section 3: four distances of all nodes in centimetres, value by value."""
    for name in ["drawn_m", "drawn_max_m", "source_m", "source_max_m"]:
        for node in nodes:
            node[name] = reader.one("H") / 100
    reader.finish()
