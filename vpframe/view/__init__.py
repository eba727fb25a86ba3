"""Views of a session: meshcat in the browser, rerun on disk, still pictures without a screen.

Nothing here changes a scene. Heavy libraries are imported by the module that needs them, at its first use.
May use `session`, `scene` and `events`. One set of symbols, colours and cameras serves all three.
Start with `symbols`, then `meshcat_viewer` and `server` (live page), `recorder` (rerun), `snapshot` (pictures).
"""
