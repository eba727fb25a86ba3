"""Views of a session: meshcat in the browser, rerun on disk, still pictures without a screen.

Nothing here changes a scene. Heavy libraries are imported by the module that needs them, at its first use.
"""
