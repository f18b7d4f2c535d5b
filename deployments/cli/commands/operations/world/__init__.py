"""Look at worlds, prove, vary, light and draw them: show, view, sheet, prove, vary, relight, import, map."""
