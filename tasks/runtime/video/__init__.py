"""Video: recorded during a run, rendered after a failed run, and live on a page.

May import: `schemas`, `tasks.runtime.episode`, `tasks.runtime.limits`, `tasks.runtime.recording`,
`tasks.runtime.rendering`, `tasks.runtime.states`.
"""

__all__ = [
    "camera_recorder",
    "failure_videos",
    "live_view",
    "recorded_camera_settings",
    "video",
    "video_files",
    "video_settings",
]
