"""Shapes of the wire, states, errors and specifications; nothing here touches files, processes or networks."""
