"""A house in Gazebo's format, a few kB: models, meshes, a door, a saved state, and faults that public ones have.

The frame of the file has its origin in the west room; the house is 8 m wide and 5 m deep, walls are 20 cm thick, and
the two rooms are joined by a doorway of 1 m with a hinge door.
"""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

Box = tuple[float, float, float, float, float, float]
"""West, south, bottom, east, north, top."""

WALLS: list[Box] = [
    (-2.2, -2.7, 0.0, 6.2, -2.5, 2.5), (-2.2, 2.5, 0.0, 6.2, 2.7, 2.5), (-2.2, -2.5, 0.0, -2.0, 2.5, 2.5),
    (6.0, -2.5, 0.0, 6.2, 2.5, 2.5), (2.0, -2.5, 0.0, 2.2, -0.5, 2.5), (2.0, 0.5, 0.0, 2.2, 2.5, 2.5),
    (2.0, -0.5, 2.1, 2.2, 0.5, 2.5),
]  # fmt: skip
"""The walls: an open shell, without bottoms; the last is the lintel."""

Triangle = tuple[tuple[float, float, float], ...]


def triangles_of(box: Box, *, is_open: bool = False) -> list[Triangle]:
    """The surface of a box, outsides counter-clockwise; an open one has no bottom."""
    x0, y0, z0, x1, y1, z1 = box
    p = [(x, y, z) for z in (z0, z1) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
    quads = [(4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)] + ([] if is_open else [(3, 2, 1, 0)])
    return [each for a, b, c, d in quads for each in ((p[a], p[b], p[c]), (p[a], p[c], p[d]))]


def dae(triangles: Sequence[Triangle], unit: float = 1.0, picture: str = "") -> str:
    """A COLLADA file that says `Y_UP`, as many do that are Z up; lengths are stored in its unit."""
    points = np.array(triangles).reshape(-1, 3) / unit
    floats = " ".join(f"{value:.6g}" for value in points.ravel())
    places = " ".join(f"{x:.3g} {y:.3g}" for x, y in points[:, :2] * unit)
    index = " ".join(f"{i} {i}" for i in range(len(points)))
    image = (
        f'<library_images><image id="i"><init_from>{picture}</init_from></image></library_images>' if picture else ""
    )
    color = (
        '<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>'
        '<newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam>'
        '<technique sid="c"><lambert><diffuse><texture texture="t" texcoord="UV"/></diffuse></lambert></technique>'
        if picture
        else '<technique sid="c"><lambert><diffuse><color>0.2 0.4 0.6 1</color></diffuse></lambert></technique>'
    )
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="unit" meter="{unit:g}"/><up_axis>Y_UP</up_axis></asset>{image}
<library_effects><effect id="e"><profile_COMMON>{color}</profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g" name="g"><mesh>
<source id="p"><float_array id="pa" count="{points.size}">{floats}</float_array><technique_common>
<accessor source="#pa" count="{len(points)}" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<source id="u"><float_array id="ua" count="{2 * len(points)}">{places}</float_array><technique_common>
<accessor source="#ua" count="{len(points)}" stride="2"><param name="S" type="float"/><param name="T" type="float"/>
</accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles material="m" count="{len(triangles)}"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#u" offset="1" set="0"/><p>{index}</p></triangles></mesh></geometry>
</library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="m" target="#m"/></technique_common></bind_material></instance_geometry></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


def model(name: str, body: str, *, version: str = "1.6", static: str = "<static>true</static>") -> str:
    """A model file."""
    return f'<?xml version="1.0"?>\n<sdf version="{version}"><model name="{name}">{static}{body}</model></sdf>\n'


def mesh_link(mesh: str, more: str = "", visual: str = "") -> str:
    """A link that collides as it looks."""
    seen = visual or mesh
    return (
        f'<link name="link"><collision name="c"><geometry><mesh><uri>{mesh}</uri></mesh></geometry>{more}</collision>'
        f'<visual name="v"><geometry><mesh><uri>{seen}</uri></mesh></geometry></visual></link>'
    )


STICKY = "<surface><friction><ode><mu>100</mu><mu2>50</mu2></ode></friction></surface>"

DOOR = """<frame name="hinge"><pose>2.1 -0.5 0 0 0 0</pose></frame>
<link name="frame"><pose relative_to="hinge"/><collision name="c"><pose>0 -0.05 1 0 0 0</pose>
<geometry><box><size>0.1 0.1 2</size></box></geometry></collision></link>
<link name="leaf"><pose relative_to="hinge">0 0 0.02 0 0 0.1</pose><inertial><pose>0.45 0 1 0 0 0</pose><mass>12</mass>
<inertia><ixx>4</ixx><iyy>4.8</iyy><izz>0.82</izz></inertia></inertial>
<collision name="c"><pose>0.47 0 1 0 0 0</pose><geometry><box><size>0.9 0.04 2</size></box></geometry></collision>
<visual name="v"><pose>0.47 0 1 0 0 0</pose><geometry><box><size>0.9 0.04 2</size></box></geometry></visual></link>
<joint name="anchor" type="fixed"><parent>world</parent><child>frame</child></joint>
<joint name="hinge_joint" type="revolute"><parent>frame</parent><child>leaf</child>
<axis><xyz>0 0 1</xyz><limit><lower>-0.2</lower><upper>1.47</upper></limit>
<dynamics><damping>0.5</damping></dynamics></axis>
</joint>"""

CRATE = """<link name="link"><inertial><mass>2</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>9</izz></inertia></inertial>
<collision name="c"><geometry><box><size>0.4 0.4 0.4</size></box></geometry></collision>
<visual name="v"><geometry><box><size>0.4 0.4 0.4</size></box></geometry>
<material><script><name>Gazebo/Wood</name></script></material></visual>
<sensor name="scale" type="force_torque"/></link>"""

# Its footprint is centred on `corner`, which the include places.
SHELF = """<frame name="corner"><pose>-0.2 -0.5 0 0 0 0</pose></frame>
<link name="link"><collision name="c"><pose>0 0 0.9 0 0 0</pose><geometry><box><size>0.4 1 1.8</size></box></geometry>
</collision><visual name="v"><pose>0 0 0.9 0 0 0</pose><geometry><box><size>0.4 1 1.8</size></box></geometry>
<material><script><name>Nowhere/Known</name></script></material></visual></link>"""

WORLD = """<!-- saved by hand -->
<?xml version="1.0"?>
<sdf version="1.7"><world name="default">
<include><uri>model://sun</uri></include>
<include><uri>model://ground_plane</uri></include>
<include><uri>model://walls</uri><pose>0 0 0.03 0 0 0</pose></include>
<model name="floor"><static>true</static><link name="link"><collision name="c"><pose>2 0 -0.02 0 0 0</pose>
<geometry><box><size>8.4 5.4 0.1</size></box></geometry>{sticky}</collision>
<visual name="v"><pose>2 0 -0.02 0 0 0</pose>
<geometry><box><size>8.4 5.4 0.1</size></box></geometry></visual></link></model>
<model name="furnishing"><pose>0 0 0.03 0 0 0</pose>
<include><uri>model://table</uri><pose>4.5 1.4 0 0 0 1.5707963</pose></include>
<include><uri>model://table</uri><name>table_2</name><pose>4.5 -1.6 0 0 0 0</pose></include></model>
<include placement_frame="corner"><uri>model://shelf</uri><placement_frame>corner</placement_frame>
<pose>-2 1.5 0.03 0 0 0</pose></include>
<include><uri>model://door</uri><pose>0 0 0.03 0 0 0</pose></include>
<include><uri>model://crate</uri><pose>9 9 9 0 0 0</pose></include>
<include><uri>model://crate</uri><name>sunk</name><pose>5.5 1.9 0.13 0 0 0</pose></include>
<include><uri>model://ghost</uri><pose>3 0 1 0 0 0</pose></include>
<include><uri>model://lamp</uri><pose>1.7 -2.2 0.03 0 0 0</pose></include>
{more}
<actor name="walker"/>
<plugin name="weather" filename="libweather.so"/>
<state world_name="default"><model name="crate"><pose>0.8 -1.5 0.24 0 0 0.4</pose><scale>1 1 1</scale>
<link name="link"><pose>0.8 -1.5 0.24 0 0 0.4</pose></link></model></state>
</world></sdf>
"""


def write_house(folder: Path, more: str = "") -> Path:
    """Writes the package with all its models.

    Args:
        folder: A new folder.
        more: Further elements of the world.

    Returns:
        The world file.
    """
    walls = [triangle for box in WALLS for triangle in triangles_of(box, is_open=box[2] == 0)]
    table: list[Box] = [
        (-0.8, -0.4, 0.72, 0.8, 0.4, 0.76), (-0.78, -0.38, 0, -0.7, -0.3, 0.72), (0.7, -0.38, 0, 0.78, -0.3, 0.72),
        (-0.78, 0.3, 0, -0.7, 0.38, 0.72), (0.7, 0.3, 0, 0.78, 0.38, 0.72),
    ]  # fmt: skip
    whole_table = dae([each for box in table for each in triangles_of(box)], 0.01, "wood.jpg")
    texts = {
        "package.xml": "<package><name>house</name></package>",
        "worlds/house.world": WORLD.format(sticky=STICKY, more=more),
        "models/walls/model.sdf": model("walls", mesh_link("model://walls/meshes/walls.dae", STICKY)),
        "models/walls/meshes/walls.dae": dae(walls, 0.01),
        "models/table/model.config": "<model><sdf version='1.6'>table.sdf</sdf></model",  # no XML, as some are
        "models/table/model.sdf": model("table", mesh_link("model://table/meshes/table.dae")),
        "models/table/meshes/table.dae": whole_table,
        "models/shelf/model.sdf": model("shelf", SHELF, version="1.8"),
        "models/door/model.sdf": model("door", DOOR, version="1.8", static=""),
        "models/crate/model.sdf": model("crate", CRATE, static=""),
        "models/ghost/model.sdf": model("ghost", '<link name="link"/>', static=""),
        "models/lamp/model.sdf": model(
            "lamp",
            '<link name="link"><collision name="c"><pose>0 0 0.5 0 0 0</pose><geometry><cylinder><radius>0.15</radius>'
            '<length>1</length></cylinder></geometry></collision><visual name="v"><geometry><mesh>'
            "<uri>model://lamp/meshes/cut.dae</uri></mesh></geometry></visual></link>",
        ),
        "models/lamp/meshes/cut.dae": whole_table[: len(whole_table) // 2],
    }
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    picture = BytesIO()
    Image.fromarray(np.random.default_rng(1).integers(0, 255, (600, 700, 3), np.uint8)).save(picture, "JPEG")
    textures = folder / "models" / "table" / "materials" / "textures"
    textures.mkdir(parents=True)
    (textures / "wood.jpg").write_bytes(picture.getvalue())
    return folder / "worlds" / "house.world"
