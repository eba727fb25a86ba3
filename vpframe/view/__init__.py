"""Seen and kept: meshcat in the browser, rerun on disk, and still pictures that need no screen.

Nothing here changes a scene. Heavy libraries are imported by the module that needs them, at its first use.
"""
