"""Comparisons of a city's decoded tiles with each other and with what `insula-server` says about them."""
import datetime, json, pathlib, subprocess, tempfile
from . import map_image
from .blockmap import read_blockmap
from .container import BadTile, read_archive, read_container
from .ground_columns import stand_on_ground
from .mesh_tile import TEXTURE, read_name, webp_size
from .object_tile import read_object_tile


def nodes_of(subtrees):
    """The nodes of all subtree tiles by id."""
    return {node["id"]: node for subtree in subtrees for node in subtree["nodes"]}


def read_mesh_archive(city):
    """The bytes of all mesh tiles by leaf and level of detail, which the tiles name, too."""
    depth, tiles = json.loads((city / "city.json").read_text())["depth"], {}
    if not (city / "meshes.pmtiles").exists():
        return tiles
    for z, x, y, data in read_archive(city / "meshes.pmtiles"):
        lod = z - depth
        name = f"{depth}/{x >> lod}/{y >> lod}", lod
        _, tile_id, sections = read_container(data)
        if read_name(tile_id, sections) != name:
            raise BadTile(f"mesh tile {z}/{x}/{y} names another leaf or level of detail")
        tiles[name] = data
    return tiles


def read_object_archive(city):
    """The schema, then all blocks, as (name, values); nothing in a city without objects."""
    path = city / "objects.pmtiles"
    if not path.exists():
        return
    tiles = {}
    for *place, data in read_archive(path):
        _, tile_id, tiles[tuple(place)] = read_container(data)
        if tile_id != tuple(place):
            raise BadTile(f"object tile {place} names another place")
    if (0, 0, 0) not in tiles:
        raise BadTile("objects without a schema")
    values = read_object_tile((0, 0, 0), tiles.pop((0, 0, 0)))
    yield "schema of objects", values
    for place, sections in sorted(tiles.items()):
        block = read_object_tile(place, sections, values["schema"])
        yield f"objects {block['block']}", block


def read_objects(city):
    """All objects by number, with names of attributes and texts of dates."""
    objects, attributes = {}, []
    for _, values in read_object_archive(city):
        if values["kind"] == "schema":
            attributes = values["schema"]["attributes"]
            continue
        for item in values["objects"]:
            named = {attributes[place]["name"]: readable(value, attributes[place]["type"])
                     for place, value in item["attributes"].items()}
            objects[item["number"]] = item | {"attributes": named}
    return objects


def readable(value, value_type):
    """A date as text; years beyond 1 to 9999 fail."""
    return str(datetime.date(1970, 1, 1) + datetime.timedelta(value)) if value_type == "date" else value


def are_objects_equal(program, city, objects):
    """Compares all objects with those that `objects` prints."""
    numbers, equal = sorted(objects), True
    for start in range(0, len(numbers), 1000):
        ids = ",".join(map(str, numbers[start:start + 1000]))
        text = subprocess.run([program, "objects", city, "--ids", ids, "--json"], check=True, capture_output=True).stdout
        for found in json.loads(text):
            item = objects[found["id"]]
            parent = objects[item["parent"]]["identifier"] if "parent" in item else None
            own = {key: item[key] for key in ("identifier", "kind", "attributes")} | {"id": item["number"], "parent": parent}
            if own != found:
                equal = False
                print(f"object {found['id']}: found {own}, expected {found}")
    return equal


def are_sizes_equal(blockmaps, meshes, subtrees):
    """Compares the sizes of all tiles with those in the subtree tiles."""
    nodes = nodes_of(subtrees)
    listed = {name: node["blockmap_bytes"] for name, node in nodes.items()}
    listed_meshes = {(name, k): lod["bytes"] for name, node in nodes.items() for k, lod in enumerate(node.get("meshes", []))}
    return listed == {name: len(data) for name, data in blockmaps} and listed_meshes == {
        name: len(data) for name, data in meshes.items()}


def are_levels_equal(program, city, subtrees):
    """Compares the nodes of all subtree tiles with the levels that `inspect` counts."""
    text = subprocess.run([program, "inspect", city, "--json"], check=True, capture_output=True).stdout
    nodes, equal = nodes_of(subtrees), True
    for level in json.loads(text)["levels"]:
        own = [node for name, node in nodes.items() if name.startswith(f"{level['level']}/")]
        sizes, errors = [node["blockmap_bytes"] for node in own], [node["error_m"] for node in own]
        found = [len(own), sum(sizes), min(sizes), max(sizes), min(errors), max(errors)]
        names = ["nodes", "bytes", "bytes_min", "bytes_max", "error_m_min", "error_m_max"]
        if found != [level[name] for name in names]:
            equal = False
            print(f"level {level['level']}: found {found}")
    return equal


def is_equal_to_inspect(program, city, name, data):
    """Compares a V-BlockMap tile, with its ground, with the three maps that `inspect` draws."""
    _, tile_id, sections = read_container(data)
    tile, ground = read_blockmap(tile_id, sections)
    if ground:
        stand_on_ground(tile, ground)
    with tempfile.TemporaryDirectory() as folder:
        png = pathlib.Path(folder) / "node.png"
        subprocess.run([program, "inspect", city, "--tile", name, "--png", png], check=True, stdout=subprocess.DEVNULL)
        expected = map_image.read_png(png.read_bytes())
    found = map_image.draw(tile)
    if found == expected:
        return True
    rows = zip(found, expected)
    differing = [(x, y, a, b) for y, row in enumerate(rows) for x, (a, b) in enumerate(zip(*row)) if a != b]
    print(f"{name}: {len(differing)} pixels differ; x, y, found, expected of the first:", *differing[:3])
    return False


def is_equal_to_subtree(name, data, values, nodes):
    """Compares a decoded mesh tile with what its leaf's subtree tile says of it, and the size of its texture."""
    _, _, sections = read_container(data)
    listed = dict(enumerate(nodes.get(values["leaf"], {}).get("meshes", []))).get(values["lod"], {})
    size = values["texture"]["size_px"] if TEXTURE in sections else (0, 0)
    found = {"bytes": len(data), "triangles": len(values["triangles"]), "texture_px": size[0] * size[1]}
    if found != {key: listed.get(key) for key in found}:
        print(f"{name}: found {found}, but the subtree says {listed}")
        return False
    if TEXTURE in sections and webp_size(sections[TEXTURE]) != size:
        print(f"{name}: the texture has another size than meta says")
        return False
    return True


def is_on_common_grid(name, values, side_m):
    """Whether the corners of the mesh's leaf are points of its grid."""
    grid = [*values["grid_min"][:2], side_m]
    if all((number / values["grid_step"]).is_integer() for number in grid):
        return True
    print(f"{name}: the leaf's corners are not on its grid")
    return False
