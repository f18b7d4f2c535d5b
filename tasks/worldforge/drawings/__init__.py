"""Imports of floor plans that people drew (SVG, DXF) or robots mapped: reads them and makes worlds of them."""
