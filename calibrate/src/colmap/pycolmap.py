"""Stands in for the colmap program: one step by pycolmap 4.x.

Called as `python -c <this> version` or `python -c <this> STEP JOB`, where JOB is a JSON object.
"""

import json
import sys

import pycolmap


def extract(job):
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "PINHOLE"
    reader.camera_params = job["camera_params"]
    options = pycolmap.FeatureExtractionOptions()
    options.use_gpu = False
    options.num_threads = job["threads"]
    options.max_image_size = job["max_image_size"]
    options.sift.max_num_features = job["max_features"]
    options.sift.peak_threshold = job["peak_threshold"]
    options.sift.edge_threshold = job["edge_threshold"]
    pycolmap.extract_features(
        job["database"],
        job["images"],
        job["names"],
        pycolmap.CameraMode.PER_FOLDER,
        reader,
        options,
        pycolmap.Device.cpu,
    )


def triangulate(job):
    options = pycolmap.IncrementalPipelineOptions()
    options.extract_colors = False
    options.num_threads = job["threads"]
    options.mapper.filter_max_reproj_error = job["max_error_px"]
    options.mapper.filter_min_tri_angle = job["min_ray_angle_deg"]
    options.triangulation.min_angle = job["min_ray_angle_deg"]
    model = pycolmap.Reconstruction(job["input"])
    pycolmap.triangulate_points(model, job["database"], job["images"], job["output"], True, options, False)


def verify(job):
    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu = False
    matching.num_threads = job["threads"]
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = job["seed"]
    pycolmap.match_exhaustive(
        job["database"],
        matching_options=matching,
        verification_options=verification,
        device=pycolmap.Device.cpu,
    )


def build(job):
    options = pycolmap.IncrementalPipelineOptions()
    options.extract_colors = False
    options.num_threads = job["threads"]
    options.random_seed = job["seed"]
    options.min_model_size = 3
    options.ba_refine_focal_length = job["refine_intrinsics"]
    options.ba_refine_extra_params = job["refine_intrinsics"]
    options.ba_refine_principal_point = False
    pycolmap.incremental_mapping(job["database"], job["images"], job["output"], options)


if sys.argv[1] == "version":
    print(pycolmap.__version__)
else:
    STEPS = {"extract": extract, "triangulate": triangulate, "verify": verify, "map": build}
    STEPS[sys.argv[1]](json.loads(sys.argv[2]))
