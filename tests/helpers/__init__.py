"""What tests of several folders share; README.md lists it."""
