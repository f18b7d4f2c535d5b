"""An application with everything that goes wrong in applications."""
