"""Every RoboMaker operation as a Prefect flow, in `operations`; specifications are run by the flow of `pipelines`."""
