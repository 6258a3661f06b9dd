"""Texels of a V-BlockMap (docs/formats.md, "The columns section", pass `appearance`)."""
from .range_coder import bit_model, bit_models, number_models
from .shapes import CLIPPED, COLUMNS, HOLES, OCCUPIED, SIDES, clamp, loco_i, neighbour

LUMA_ENDS = [0, 2, 4, 7, 11, 18, 30]
# What a texel is predicted from where nothing is known: (colour as Y, Co, Cg; occlusion).
GREY = ((128, 0, 0), 63)


def read_appearance(coder, tile, order, luma_step, ao_step):
    texels = TexelReader(coder, read_palette(coder), luma_step, ao_step)
    roofs = read_roofs(texels, tile)
    read_outer_tops(texels, tile, roofs)
    read_strips(texels, tile, order, roofs)


def read_palette(coder):
    count = coder.choice(bit_models(127))
    if count > 64:
        return None
    models, colour, palette = [bit_models(255) for _ in range(3)], (0, 0, 0), []
    for _ in range(count):
        colour = tuple(colour[k] + coder.choice(models[k]) & 255 for k in range(3))
        palette.append(to_ycocg(colour))
    return palette


def to_ycocg(rgb):
    r, g, b = rgb
    orange = r - b
    t = b + (orange >> 1)
    green = g - t
    return t + (green >> 1), orange, green


def to_rgb(colour):
    y, orange, green = colour
    t = y - (green >> 1)
    b = t - (orange >> 1)
    return tuple(clamp(v, 0, 255) for v in (b + orange, green + t, b))


def toward_zero(numerator, denominator):
    quotient = abs(numerator) // denominator
    return quotient if numerator >= 0 else -quotient


class TexelReader:
    """The table "component, coding". Known texels are (colour, occlusion)."""

    def __init__(self, coder, palette, luma_step, ao_step):
        self.coder, self.palette, self.luma_step, self.ao_step = coder, palette, luma_step, ao_step
        self.chroma_step = luma_step if luma_step == 4 else luma_step * 3 // 2
        self.luma, self.ao = number_models(8), number_models(8)
        self.chroma = [number_models(6) for _ in range(2)]
        self.coverage = {coverage: bit_models(3) for coverage in (0, 3)}
        self.first, self.second = bit_models(3), bit_model()
        places = 1
        while palette is not None and places < len(palette):
            places *= 2
        self.place = bit_models(places - 1)

    def read(self, known):
        """Returns the texel and what it is as a known one."""
        colours = [colour for colour, _ in known]
        colour = self.read_colour(colours) if self.palette is None else self.read_place(colours)
        ao = self.read_ao([ao for _, ao in known])
        return (*to_rgb(colour), ao, 3), (colour, ao)

    def read_coverage(self, below):
        return self.coder.choice(self.coverage[below]) and 3

    def read_place(self, colours):
        a, b, c = colours
        if len(self.palette) == 1:
            return self.palette[0]
        if self.coder.bit(self.first[(a == b) + (b == c)]):
            return a
        if a != b and self.coder.bit(self.second):
            return b
        place = self.coder.choice(self.place)
        return self.palette[place] if place < len(self.palette) else a

    def read_colour(self, colours):
        coder, step = self.coder, self.luma_step
        a, b, c = (colour[0] for colour in colours)
        activity = min(abs(a - c) + abs(b - c), 1023) * 8 // step
        k = coder.number(self.luma[sum(activity > end for end in LUMA_ENDS)])
        out = [clamp(loco_i(a, b, c) + toward_zero(k * step, 4), 0, 255)]
        differs, step = k != 0, self.chroma_step
        for n in (1, 2):
            a, b, c = (colour[n] for colour in colours)
            activity = (abs(a - c) + abs(b - c)) * 4
            level = (activity * 2 >= step) + (activity >= step * 2)
            k = coder.number(self.chroma[n - 1][level * 2 + differs])
            differs |= k != 0
            out.append(clamp(loco_i(a, b, c) + toward_zero(k * step, 4), -255, 255))
        return tuple(out)

    def read_ao(self, known):
        a, b, c = known
        step, activity = self.ao_step, abs(a - c) + abs(b - c)
        model = self.ao[0 if activity == 0 else 1 + min(activity // step, 6)]
        level = (loco_i(a, b, c) + step // 2) // step + self.coder.number(model)
        return min(63, clamp(level, 0, 63) * step)


def read_roofs(texels, tile):
    """Returns the roofs as known texels."""
    roofs, last = [None] * COLUMNS, None
    for i in range(COLUMNS):
        if not tile.has(i, OCCUPIED):
            continue
        around = [neighbour(i, -1, 0), neighbour(i, 0, -1), neighbour(i, -1, -1)]
        exists = [tile.has(j, OCCUPIED) for j in around]
        level = [e and abs(tile.z_max[j] - tile.z_max[i]) <= tile.codes_per_cell for e, j in zip(exists, around)]
        known = substitutes(around, level if any(level) else exists)
        if known is None:
            known = [GREY if last is None else roofs[last]] * 3
        else:
            known = [roofs[j] for j in known]
        tile.roof[i], roofs[i] = texels.read(known)
        last = i
    return roofs


def substitutes(around, usable):
    """W, S, C with those that are not usable replaced; None if none is."""
    a, b, c = around
    if all(usable):
        return [a, b, c]
    if usable[0]:
        return [a, b if usable[1] else a, a]
    return [b] * 3 if usable[1] else [c] * 3 if usable[2] else None


def read_outer_tops(texels, tile, roofs):
    for i in range(COLUMNS):
        if tile.has(i, CLIPPED) and tile.clip[i]["outer"] is not None:
            outer = tile.clip[i]["outer"]
            beside = (neighbour(i, dx, dy) for dx, dy in SIDES)
            beside = [j for j in beside if tile.has(j, OCCUPIED)]
            nearest = min(beside, key=lambda j: abs(tile.z_max[j] - outer), default=i)
            texel, _ = texels.read([roofs[nearest]] * 3)
            tile.clip[i]["outer"] = (outer, texel)


def read_strips(texels, tile, order, roofs):
    coded = {}
    for i, predecessor in order:
        first, rows = tile.rows(i)
        tile.strip[i] = []
        coverage, below = 3, None
        beside_below = coded.get((predecessor, first - 1))
        for row in range(first, first + rows):
            beside = coded.get((predecessor, row))
            if below and beside:
                known = [below, beside, beside_below or beside]
            else:
                known = [below or beside or roofs[i]] * 3
            beside_below = beside
            if tile.has(i, HOLES):
                coverage = texels.read_coverage(coverage)
            if coverage == 0:
                texel, below = (0, 0, 0, 0, 0), known[0]
            else:
                texel, below = texels.read(known)
            tile.strip[i].append(texel[:4] + (coverage,))
            coded[i, row] = below
