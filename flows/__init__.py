"""Every RoboMaker operation as a Prefect flow, in the module of its resource; their steps are in `steps`."""
