"""A module that ends the process when it is imported."""

import sys

sys.exit("I never wanted to be imported")
