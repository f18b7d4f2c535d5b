"""RoboMaker operations as Prefect flows, in `operations`; the flow in `pipelines` runs specifications."""
