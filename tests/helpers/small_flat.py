"""A template of two rooms: small enough for tests to generate worlds of it."""

ROLE = "arn:aws:iam::000000000000:role/test"
BODY = {
    "Buildings": [
        {
            "Floors": [
                {
                    "Floorplan": {
                        "Rooms": [
                            {
                                "Type": "Living",
                                "Name": "living room",
                                "DesiredShape": {"Area": 16, "AspectRatio": {"x": 1, "y": 1}},
                            },
                            {
                                "Type": "Bedroom",
                                "Name": "bedroom",
                                "DesiredShape": {"Area": 12, "AspectRatio": {"x": 1, "y": 1}},
                            },
                        ]
                    }
                }
            ]
        }
    ]
}
