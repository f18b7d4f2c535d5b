"""Where modules were before they moved: the table that `old_paths.py` keeps old import paths working with."""

ROOT = __name__.partition(".")[0] + "."
"""What every path of this package begins with."""

# Where modules were, where they are, and their names; `old=new` for those that were renamed.
_GROUPS = (
    (
        "schemas",
        "schemas.operations",
        "applications deployment_jobs fleets operation_groups=resources operations=registry robot_applications robots "
        "simulation_applications simulation_job_batches simulation_jobs tags world_export_jobs world_generation_jobs "
        "world_templates worlds",
    ),
    ("schemas.operations", "schemas.runs", "requested_requirements"),
    ("schemas.operations", "schemas.wire", "deprecations"),
    ("schemas", "schemas.reports", "progress report report_summary=summary run_record"),
    (
        "schemas",
        "schemas.runs",
        "failure_state manifest provenance requirement_orders=requested_requirements requirements "
        "robot_model=robot_yaml run_programs=programs run_variables=variables simulation_run=plan verification",
    ),
    (
        "schemas",
        "schemas.specs",
        "reference_kinds reference_typing references spec=model spec_check=check spec_inputs=inputs "
        "spec_rooms=rooms spec_schema=json_schema spec_text=text spec_world_counts=world_counts",
    ),
    (
        "schemas",
        "schemas.templates",
        "world_template_body=body world_template_doorways=doorways world_template_parsing=parsing "
        "world_template_rules=rules world_template_targets=targets",
    ),
    (
        "schemas",
        "schemas.wire",
        "arns base common deprecations errors globs ids operation_shape request_problems "
        "simulation_job_configs=job_configs strict_json",
    ),
    ("schemas", "schemas.worlds", "polygons world world_checks=checks world_description=description"),
    (
        "tasks",
        "tasks.execution",
        "artifacts giving_up=retry_limit held_leases job_leases performing=one_worker_per_job slots=batch_slots "
        "task_pool",
    ),
    ("tasks", "tasks.fleet", "fleets=records"),
    ("tasks", "tasks.inspection", "found_runs replays reports"),
    ("tasks", "tasks.jobs", "generation_runs job_endings=simulation_outcomes job_folders job_runs world_jobs"),
    ("tasks.reporting", "tasks.reporting.drawings", "frame furniture lettering plan svg trajectory"),
    ("tasks", "tasks.service", "builtins=builtin_applications home service"),
    (
        "tasks",
        "tasks.simulations.containers",
        "container_argv=command_lines container_leftovers=cleanup container_outputs=outputs container_plans=plans "
        "containers=engines",
    ),
    (
        "tasks",
        "tasks.simulations.environment",
        "compute process_variables sandbox=folders shared_memory surroundings=run_environment",
    ),
    ("tasks", "tasks.simulations.inputs", "bundles data_sources world_rooms"),
    (
        "tasks",
        "tasks.simulations.outputs",
        "rolling_uploads run_outputs upload_configurations upload_files upload_names=distinct_names "
        "uploads=output_places",
    ),
    ("tasks", "tasks.simulations.planning", "application_plans applications launching resuming run_plans"),
    ("tasks", "tasks.simulations.ros", "ros_domains=domains ros_launching=launching"),
    (
        "tasks",
        "tasks.worlds",
        "world_builders=builders world_bundles=bundles world_export=export world_generation=generation",
    ),
    (
        "tasks.runtime",
        "tasks.runtime.agents",
        "action_log action_log_writer agent_client agent_greeting agent_layout agent_protocol agent_socket "
        "recorded_robot remote_agent remote_robot",
    ),
    (
        "tasks.runtime",
        "tasks.runtime.episode",
        "clearance contact_forces context loading physics program_names progress results resumable robot_body stops",
    ),
    (
        "tasks.runtime",
        "tasks.runtime.limits",
        "capped_logs disk_use disk_walk left_files limits logs processes run_notes",
    ),
    ("tasks.runtime", "tasks.runtime.process", "child joint_states loop observers rehearsal run_request waiting_run"),
    (
        "tasks.runtime",
        "tasks.runtime.recording",
        "camera_frames cdr columns display_messages foxglove links mcap_file mcap_messages messages recorder "
        "recording recording_streams rosbag2 scan_series state_series",
    ),
    (
        "tasks.runtime",
        "tasks.runtime.rendering",
        "cameras drawing gl ray_camera video_backends=backends view_culling views",
    ),
    ("tasks.runtime", "tasks.runtime.replay", "replay repro run_comparison=divergence"),
    (
        "tasks.runtime",
        "tasks.runtime.requirements",
        "requirement_checks=measurements requirement_rules=rules requirements=observer",
    ),
    (
        "tasks.runtime",
        "tasks.runtime.states",
        "checkpoint_files checkpoints digest failure_state kept_physics=physics_state provenance state_log "
        "state_log_writer",
    ),
    (
        "tasks.runtime",
        "tasks.runtime.supervision",
        "cores=core_assignment disk_blame=disk_attribution endings=finished_outputs forkserver launcher outcomes ports "
        "programs run_requests supervision=process_supervision supervisor watch=stop_monitor",
    ),
    (
        "tasks.runtime",
        "tasks.runtime.video",
        "camera_recorder camera_settings=recorded_camera_settings failure_films=failure_videos film=encoder "
        "filming=view_renderer live_frames "
        "live_view rerender video video_files video_settings",
    ),
    (
        "tasks.runtime.applications",
        "tasks.runtime.applications.indoor_navigation",
        "collisions indoor_navigation=environment level_scan lidar mission navigation_task occupancy_map scene "
        "scene_markers scene_shapes telemetry upright",
    ),
    (
        "tasks.runtime.applications",
        "tasks.runtime.applications.scout",
        "following obstacles path_smoothing plan_telemetry planner scout=agent tour",
    ),
    ("tasks.runtime.applications", "tasks.runtime", "robots"),
    ("tasks.runtime.applications", "tasks.runtime.robots", "robot_scout=scout"),
    (
        "tasks.runtime.applications.robots",
        "tasks.runtime.robots",
        "bases drives lookup robot walker walker_gait",
    ),
    (
        "tasks.runtime.applications.robots",
        "tasks.runtime.robots.robot_yaml",
        "mapped=assembly mapped_drive=drive mapped_model=model mapping menagerie model_files problems reach urdf",
    ),
    (
        "tasks.runtime.robots",
        "tasks.runtime.robots.robot_yaml",
        "mapped=assembly mapped_drive=drive mapped_model=model mapping menagerie model_files problems reach urdf",
    ),
    ("tasks.worldforge", "tasks.worldforge.bundle", "bundle worker"),
    (
        "tasks.worldforge",
        "tasks.worldforge.doors",
        "door_model=model door_parts=parts door_wishes=initial_states doors leaves",
    ),
    (
        "tasks.worldforge",
        "tasks.worldforge.exports",
        "export export_key export_meshes export_readme export_scene glb ros_packages ros_packages_launch sdf "
        "sdf_models sdf_world",
    ),
    (
        "tasks.worldforge",
        "tasks.worldforge.floorplans",
        "brief connections floorplan floorplan_rivals=rivals floorplan_wishes=preferences partition "
        "partition_batch=partition_costs partition_climb partition_search partition_shortlist partition_trees "
        "targets walls",
    ),
    (
        "tasks.worldforge",
        "tasks.worldforge.furniture",
        "arrangement furniture=catalogue furniture_cabinets=cabinets furniture_fixtures=fixtures "
        "furniture_loose=loose furniture_soft=soft furniture_tables=tables solids tops",
    ),
    ("tasks.worldforge", "tasks.worldforge.geometry", "boxes occupancy parts"),
    (
        "tasks.worldforge",
        "tasks.worldforge.interiors",
        "candidates interior kitchen_run loose_objects placement room_furnishing seating ways",
    ),
    ("tasks.worldforge", "tasks.worldforge.materials", "materials surfaces texture_patterns textures"),
    ("tasks.worldforge", "tasks.worldforge.model", "description mjcf"),
    (
        "tasks.worldforge",
        "tasks.worldforge.pictures",
        "plan_doors plan_labels plan_svg plan_symbols preview preview_light preview_palette preview_raster "
        "ray_picture room_picture",
    ),
    ("tasks.worldforge", "tasks.worldforge.proofs", "checks guarantees"),
    ("tasks.worldforge", "tasks.worldforge.viewer", "catalogue_sheet contact_sheet page_files pictures viewer_page"),
    ("flows", "tasks.inspection", "preflight"),
    ("flows", "tasks.jobs", "batch_runs"),
    ("flows", "tasks.operations", "listing=pages operation=registry"),
    ("flows", "tasks.operations.applications", "application_versions=versions applications=records"),
    (
        "tasks.operations",
        "tasks.operations.applications",
        "application_handlers=handlers application_versions=versions applications=records",
    ),
    ("deployments", "deployments", "performer=worker sdk=service_model"),
    ("deployments", "deployments.prefect_server", "local_server"),
    ("deployments", "deployments.endpoint.calling", "access_keys"),
    (
        "deployments.performer",
        "deployments.worker",
        "channel child=worker_process flow_runs jobs lanes=pools prefect_watch warm=warm_worker",
    ),
    ("deployments.sdk", "deployments.service_model", "installation service_model=model shapes waiters"),
)

MOVED: dict[str, str] = {
    f"{ROOT}{before}.{old}": f"{ROOT}{after}.{new or old}"
    for before, after, names in _GROUPS
    for old, _, new in (name.partition("=") for name in names.split())
}
"""New path of every module that moved, by its old path."""

SPLIT: dict[str, dict[str, str]] = {
    f"{ROOT}flows.operation": {
        "operation_flow": f"{ROOT}flows.lookup.find_flow",
        "perform_flow": f"{ROOT}flows.lookup.find_perform_flow",
    },
}
"""Names of an old module that are elsewhere than the rest of it."""
