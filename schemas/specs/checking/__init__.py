"""Parts of the check of a specification: inputs, misspelt members, the order of steps, and names of applications."""
