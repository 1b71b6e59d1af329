"""Tanks from closed surfaces of triangles."""

def read_surface(path):
    raise NotImplementedError
