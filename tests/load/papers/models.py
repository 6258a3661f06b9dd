"""Models of the kinds and sizes of the papers' models, which are not public."""

import json, math, shutil


def read_mesh(path):
    """Vertices and triangles of an OBJ, or of a PLY in text."""
    vertices, triangles = [], []
    with open(path) as file:
        if path.suffix == ".ply":
            counts = {}
            for line in file:
                words = line.split()
                if words[0] == "element":
                    counts[words[1]] = int(words[2])
                if words[0] == "end_header":
                    break
            vertices = [tuple(map(float, next(file).split()[:3])) for _ in range(counts["vertex"])]
            triangles = [tuple(map(int, next(file).split()[1:4])) for _ in range(counts["face"])]
            return vertices, triangles
        for line in file:
            if line.startswith("v "):
                vertices.append(tuple(map(float, line.split()[1:4])))
            elif line.startswith("f "):
                corners = [int(word.split("/")[0]) - 1 for word in line.split()[1:]]
                triangles += [(corners[0], corners[i], corners[i + 1]) for i in range(1, len(corners) - 1)]
    return vertices, triangles


def write_obj(path, objects):
    """Writes (name, vertices, triangles, colour) as an OBJ, with its colours as materials beside it."""
    colours = sorted({colour for *_, colour in objects if colour})
    with open(path, "w") as file:
        if colours:
            library = path.with_suffix(".mtl")
            library.write_text("".join(f"newmtl c{i}\nKd {r} {g} {b}\n" for i, (r, g, b) in enumerate(colours)))
            file.write(f"mtllib {library.name}\n")
        first, last_name = 1, None
        for name, vertices, triangles, colour in objects:
            if name != last_name:
                file.write(f"o {name}\n")
            last_name = name
            if colour:
                file.write(f"usemtl c{colours.index(colour)}\n")
            file.write("".join(f"v {x:.6g} {y:.6g} {z:.6g}\n" for x, y, z in vertices))
            file.write("".join(f"f {a + first} {b + first} {c + first}\n" for a, b, c in triangles))
            first += len(vertices)
    return path


# Single meshes.


def subdivide(vertices, triangles):
    """Loop's subdivision of a closed mesh: four triangles for each, on a smooth surface."""
    beside = {}
    for a, b, c in triangles:
        for u, v, w in ((a, b, c), (b, c, a), (c, a, b)):
            beside.setdefault((u, v) if u < v else (v, u), []).append(w)
    around = [[] for _ in vertices]
    for u, v in beside:
        around[u].append(v)
        around[v].append(u)
    weights = {}
    moved = []
    for place, near in zip(vertices, around):
        n = len(near)
        if n not in weights:
            weights[n] = (5 / 8 - (3 / 8 + math.cos(2 * math.pi / n) / 4) ** 2) / n if n else 0
        w = weights[n]
        moved.append(tuple((1 - n * w) * place[k] + w * sum(vertices[i][k] for i in near) for k in range(3)))
    middle = {}
    for (u, v), opposite in beside.items():
        p, q = vertices[u], vertices[v]
        middle[u, v] = len(moved)
        if len(opposite) == 2:
            r, s = vertices[opposite[0]], vertices[opposite[1]]
            moved.append(tuple(0.375 * (p[k] + q[k]) + 0.125 * (r[k] + s[k]) for k in range(3)))
        else:
            moved.append(tuple((p[k] + q[k]) / 2 for k in range(3)))
    at = lambda u, v: middle[(u, v) if u < v else (v, u)]
    finer = []
    for a, b, c in triangles:
        ab, bc, ca = at(a, b), at(b, c), at(c, a)
        finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return moved, finer


def upright(vertices, up, height, centre):
    """The vertices scaled to a height and put on the ground around a centre. `up` is the source's axis that points up."""
    if up == "y":
        vertices = [(x, -z, y) for x, y, z in vertices]
    low = [min(v[k] for v in vertices) for k in range(3)]
    high = [max(v[k] for v in vertices) for k in range(3)]
    scale = height / max(high[k] - low[k] for k in range(3))
    offset = [centre[0] - scale * (low[0] + high[0]) / 2, centre[1] - scale * (low[1] + high[1]) / 2, -scale * low[2]]
    return [tuple(scale * v[k] + offset[k] for k in range(3)) for v in vertices]


# Scenes of boxes and houses.


def box(low, high):
    """A closed box."""
    x, y, z = zip(low, high)
    vertices = [(x[i & 1], y[i >> 1 & 1], z[i >> 2]) for i in range(8)]
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return vertices, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]


def cubes(path):
    """Half a dozen cubes within 30 m, one on top of another and one in the air."""
    places = [(1, 1, 0, 8), (12, 2, 0, 6), (21, 1, 0, 7), (2, 14, 0, 10), (4, 16, 10, 6), (17, 16, 9, 10)]
    colours = [(0.75, 0.35, 0.3), (0.4, 0.55, 0.75), (0.5, 0.7, 0.4), (0.8, 0.7, 0.4), (0.6, 0.45, 0.7), (0.45, 0.65, 0.65)]
    objects = []
    for i, ((x, y, z, side), colour) in enumerate(zip(places, colours)):
        objects.append((f"cube{i}", *box((x, y, z), (x + side, y + side, z + side)), colour))
    return write_obj(path, objects)


class Surface:
    """Collects quadrilaterals."""

    def __init__(self):
        self.vertices, self.triangles = [], []

    def quad(self, *corners):
        n = len(self.vertices)
        self.vertices += corners
        self.triangles += [(n, n + 1, n + 2), (n, n + 2, n + 3)]


def facade(wall, pane, corner, along, out, length, height, storeys):
    """A wall with deep windows. `along` and `out` are unit vectors in plan."""
    bays = max(1, round(length / 2.5))
    at = lambda s, z, d: (corner[0] + along[0] * s + out[0] * d, corner[1] + along[1] * s + out[1] * d, z)
    for i in range(bays):
        s0, s1 = length * i / bays, length * (i + 1) / bays
        for j in range(storeys):
            z0, z1 = height * j / storeys, height * (j + 1) / storeys
            a0, a1, b0, b1 = s0 + 0.7, s1 - 0.7, z0 + 0.9, z1 - 0.7
            outer = [(s0, z0), (s1, z0), (s1, z1), (s0, z1)]
            inner = [(a0, b0), (a1, b0), (a1, b1), (a0, b1)]
            for k in range(4):
                (p, q), (r, t) = (outer[k], outer[(k + 1) % 4]), (inner[(k + 1) % 4], inner[k])
                wall.quad(at(*p, 0), at(*q, 0), at(*r, 0), at(*t, 0))
                wall.quad(at(*t, 0), at(*r, 0), at(*r, -0.3), at(*t, -0.3))
            pane.quad(*(at(*p, -0.3) for p in inner))


def tiled_roof(roof, x0, x1, y0, y1, eaves, rise, ribs, rows):
    """Two slopes of half-round tiles. The ridge runs along x."""
    middle = (y0 + y1) / 2
    for edge in (y0, y1):
        step = (x1 - x0) / ribs
        for i in range(ribs):
            for j in range(rows):
                ends = []
                for t, lift in ((j / rows, 0.06), ((j + 1) / rows, 0.0)):
                    y, z = edge + (middle - edge) * t, eaves + rise * t + lift
                    arc = [(i + 0.5 - 0.5 * math.cos(math.pi * k / 4), 0.12 * math.sin(math.pi * k / 4)) for k in range(5)]
                    ends.append([(x0 + step * u, y, z + h) for u, h in arc])
                for k in range(4):
                    face = [ends[0][k], ends[0][k + 1], ends[1][k + 1], ends[1][k]]
                    roof.quad(*(face if edge == y0 else reversed(face)))


def pillar(stone, x, y, height, radius, sides=12, rings=4):
    for j in range(rings):
        z0, z1 = height * j / rings, height * (j + 1) / rings
        for k in range(sides):
            a, b = (2 * math.pi * n / sides for n in (k, k + 1))
            p, q = (x + radius * math.cos(a), y + radius * math.sin(a)), (x + radius * math.cos(b), y + radius * math.sin(b))
            stone.quad((*p, z0), (*q, z0), (*q, z1), (*p, z1))


def house(name, x, y, turned, number):
    """A house with windows, a porch of pillars and a tiled roof."""
    wall, pane, roof, stone = Surface(), Surface(), Surface(), Surface()
    length, width, height = 13.0 + number % 3, 9.0 + number % 2, 6.0 + 0.5 * (number % 4)
    facade(wall, pane, (0, 0), (1, 0), (0, -1), length, height, 2)
    facade(wall, pane, (length, 0), (0, 1), (1, 0), width, height, 2)
    facade(wall, pane, (length, width), (-1, 0), (0, 1), length, height, 2)
    facade(wall, pane, (0, width), (0, -1), (-1, 0), width, height, 2)
    for gable in (0.0, length):
        wall.quad((gable, 0, height), (gable, width / 2, height + 2.2), (gable, width / 2, height + 2.2), (gable, width, height))
    tiled_roof(roof, -0.4, length + 0.4, -0.4, width + 0.4, height, 2.4, 32, 6)
    for i in range(6):
        pillar(stone, 1 + (length - 2) * i / 5, -1.8, 3.0, 0.25)
    vertices, triangles = box((0, -2.2, 3.0), (length, 0, 3.3))
    parts = [(wall.vertices, wall.triangles, (0.8, 0.72, 0.6)), (pane.vertices, pane.triangles, (0.25, 0.28, 0.32)),
             (roof.vertices, roof.triangles, (0.65, 0.38, 0.28)), (stone.vertices, stone.triangles, (0.75, 0.74, 0.7)),
             (vertices, triangles, (0.75, 0.74, 0.7))]
    place = (lambda p: (x + p[1] + 3, y + p[0], p[2])) if turned else (lambda p: (x + p[0], y + p[1] + 3, p[2]))
    flip = (lambda t: (t[0], t[2], t[1])) if turned else (lambda t: t)
    return [(name, [place(v) for v in vertices], [flip(t) for t in triangles], colour) for vertices, triangles, colour in parts]


def town(path):
    """50 houses in ten rows of five. Returns the number of triangles."""
    objects = []
    for n in range(50):
        objects += house(f"house{n}", 2 + 17.5 * (n % 10) , 2 + 30 * (n // 10), n % 2 == 1, n)
    write_obj(path, objects)
    return sum(len(triangles) for _, _, triangles, _ in objects)


def statues(path, meshes):
    """A scene of 5 x 5 statues, 64 m apart, each in the middle of a leaf at cells of 1 m. Returns the number of triangles."""
    objects = []
    for n in range(25):
        vertices, triangles, up = meshes[n % len(meshes)]
        centre = (64 * (n % 5) + 32, 64 * (n // 5) + 32)
        objects.append((f"statue{n}", upright(vertices, up, 48.0, centre), triangles, None))
    write_obj(path, objects)
    return sum(len(triangles) for _, _, triangles, _ in objects)


# Parts of real cities.


def delft_building(source, path):
    """The building of a CityJSONSeq file with the most vertices. Returns its identifier and its extent in plan."""
    with open(source) as file:
        head = next(file)
        best = max(file, key=lambda line: len(json.loads(line)["vertices"]))
    path.write_text(head + best)
    feature, scale = json.loads(best), json.loads(head)["transform"]["scale"]
    extent = [(max(v[k] for v in feature["vertices"]) - min(v[k] for v in feature["vertices"])) * scale[k] for k in range(2)]
    return feature["id"], extent


def textures_of(library):
    """The texture of each material of an MTL file that has one."""
    name, textures = "", {}
    for line in library.read_text().splitlines():
        words = line.split()
        if words[:1] == ["newmtl"]:
            name = words[1]
        elif words[:1] == ["map_Kd"]:
            textures[name] = words[1]
    return textures


def connected_parts(places, faces):
    """The faces by connected part. Vertices within a centimetre are the same."""
    welded = {}
    number = [welded.setdefault(tuple(round(c, 2) for c in place), len(welded)) for place in places]
    parent = list(range(len(welded)))

    def root(i):
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = parent[i]
        return i

    for _, corners in faces:
        for v, _ in corners[1:]:
            parent[root(number[v])] = root(number[corners[0][0]])
    parts = {}
    for face in faces:
        parts.setdefault(root(number[face[1][0][0]]), []).append(face)
    return list(parts.values())


def chiba_buildings(source, folder, count):
    """So many textured buildings around the middle of an OBJ: connected parts that are at least 3 m high. Returns the new OBJ, its
    number of triangles, and the bytes of the OBJ and of the textures that it uses."""
    places, texcoords, faces, material = [], [], [], ""
    for line in open(source):
        words = line.split()
        if line.startswith("v "):
            places.append(tuple(map(float, words[1:4])))
        elif line.startswith("vt "):
            texcoords.append(line)
        elif line.startswith("usemtl"):
            material = words[1]
        elif line.startswith("f "):
            faces.append((material, [[int(n) - 1 for n in word.split("/")[:2]] for word in words[1:] if word.count("/")]))
    library = source.with_suffix(".mtl")
    textures = textures_of(library)
    faces = [(material, corners) for material, corners in faces if len(corners) >= 3]
    values = lambda part, k: [places[v][k] for _, corners in part for v, _ in corners]
    is_building = lambda part: any(material in textures for material, _ in part) and max(values(part, 2)) - min(values(part, 2)) > 3
    parts = [part for part in connected_parts(places, faces) if is_building(part)]
    centres = [[sum(values(part, k)) / len(values(part, k)) for k in (0, 1)] for part in parts]
    middle = [sorted(c[k] for c in centres)[len(centres) // 2] for k in (0, 1)]
    chosen = sorted(range(len(parts)), key=lambda i: math.dist(centres[i], middle))[:count]
    folder.mkdir(parents=True, exist_ok=True)
    lines, new_places, new_texcoords, triangles, used = [f"mtllib {library.name}\n"], {}, {}, 0, set()
    body = []
    for n, i in enumerate(chosen):
        body.append(f"o building{n}\n")
        for material, corners in parts[i]:
            used.add(material)
            triangles += len(corners) - 2
            numbers = [(new_places.setdefault(v, len(new_places) + 1), new_texcoords.setdefault(t, len(new_texcoords) + 1)) for v, t in corners]
            body.append(f"usemtl {material}\nf {' '.join(f'{v}/{t}' for v, t in numbers)}\n")
    lines += [f"v {' '.join(map(str, places[v]))}\n" for v in new_places] + [texcoords[t] for t in new_texcoords] + body
    path = folder / "chiba.obj"
    path.write_text("".join(lines))
    shutil.copyfile(library, folder / library.name)
    files = {textures[material] for material in used if material in textures}
    for name in textures.values():
        shutil.copyfile(source.parent / name, folder / name)
    return path, triangles, path.stat().st_size + sum((folder / name).stat().st_size for name in files)
