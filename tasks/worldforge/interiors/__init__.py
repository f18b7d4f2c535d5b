"""Interiors: which furniture stands where, and small objects that lie about."""
