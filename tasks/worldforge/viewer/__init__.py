"""Pages and sheets that show worlds: the 3-D page, contact sheets, catalogue sheets.

May import: `schemas`, `tasks.worldforge.bundle`, `tasks.worldforge.exports`, `tasks.worldforge.furniture`,
`tasks.worldforge.geometry`, `tasks.worldforge.model`, `tasks.worldforge.pictures`, `tasks.worldforge.proofs`.
"""

__all__ = ["contact_sheet", "page_files", "pictures", "viewer_page"]
