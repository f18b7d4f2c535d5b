"""Built-in SDF models that worlds include without bringing them: the sun and the ground plane."""

from .xml_files import Element, parse_xml

_SUN = """<light type="directional" name="sun"><cast_shadows>true</cast_shadows><pose>0 0 10 0 0 0</pose>
<diffuse>0.8 0.8 0.8 1</diffuse><direction>-0.5 0.1 -0.9</direction></light>"""

_GROUND_PLANE = """<model name="ground_plane"><static>true</static><link name="link">
<collision name="collision"><geometry><plane><normal>0 0 1</normal><size>100 100</size></plane></geometry></collision>
<visual name="visual"><geometry><plane><normal>0 0 1</normal><size>100 100</size></plane></geometry>
<material><ambient>0.8 0.8 0.8 1</ambient><diffuse>0.8 0.8 0.8 1</diffuse></material></visual></link></model>"""

_TEXTS = {"sun": _SUN, "ground_plane": _GROUND_PLANE}


def usual_model(uri: str) -> Element | None:
    """Returns the built-in SDF model of the sun or ground plane, if an address names one.

    Args:
        uri: URI in a world file.
    """
    parts = [part for part in uri.rstrip("/").split("/") if part and not part.isdigit()]
    text = _TEXTS.get(parts[-1].lower().replace(" ", "_").replace("%20", "_")) if parts else None
    return None if text is None else parse_xml(text.encode())
