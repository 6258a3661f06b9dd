"""A second reader of city formats, which shares no code with Insula. It makes triangles in a city's coordinate system.

Every module has `read(path, target, options)`, which yields objects of `shapes.CityObject`.
"""
