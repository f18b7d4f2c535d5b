"""Writes the pages about all operations."""

from .pages import pages

if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text)
