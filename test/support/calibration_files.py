"""The same cameras as each program writes them, after its documentation."""

PINHOLE = (385.25, 386.5, 322.25, 238.75)
PLUMB_BOB = (-0.21, 0.06, 0.0004, -0.0003, 0.0)
FISHEYE = (0.012, -0.0025, 0.0007, -0.0001)

OST_YAML = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [385.25   ,   0.     , 322.25   ,
           0.     , 386.5    , 238.75   ,
           0.     ,   0.     ,   1.     ]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.21, 0.06, 0.0004, -0.0003, 0.0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1., 0., 0.,
         0., 1., 0.,
         0., 0., 1.]
projection_matrix:
  rows: 3
  cols: 4
  data: [360.5  ,   0.   , 323.5  ,   0.   ,
           0.   , 361.25 , 239.5  ,   0.   ,
           0.   ,   0.   ,   1.   ,   0.   ]
"""
OST_TXT = """\
# oST version 5.0 parameters


[image]

width
640

height
480

[narrow_stereo]

camera matrix
385.250000 0.000000 322.250000
0.000000 386.500000 238.750000
0.000000 0.000000 1.000000

distortion
-0.210000 0.060000 0.000400 -0.000300 0.000000

rectification
1.000000 0.000000 0.000000
0.000000 1.000000 0.000000
0.000000 0.000000 1.000000

projection
360.500000 0.000000 323.500000 0.000000
0.000000 361.250000 239.500000 0.000000
0.000000 0.000000 1.000000 0.000000

"""


def _column(*numbers: float) -> str:
    return ''.join(f'- {number}\n' for number in numbers)


ECHO = f"""\
header:
  stamp:
    sec: 1730000000
    nanosec: 123456789
  frame_id: camera_optical_frame
height: 480
width: 640
distortion_model: plumb_bob
d:
{_column(-0.21, 0.06, 0.0004, -0.0003, 0.0)}k:
{_column(385.25, 0.0, 322.25, 0.0, 386.5, 238.75, 0.0, 0.0, 1.0)}r:
{_column(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)}p:
{_column(360.5, 0.0, 323.5, 0.0, 0.0, 361.25, 239.5, 0.0, 0.0, 0.0, 1.0, 0.0)}binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: false
---
"""
ECHO_ROS1 = """\
header:
  seq: 4711
  stamp:
    secs: 1530000000
    nsecs: 123456789
  frame_id: "camera"
height: 480
width: 640
distortion_model: "plumb_bob"
D: [-0.21, 0.06, 0.0004, -0.0003, 0.0]
K: [385.25, 0.0, 322.25, 0.0, 386.5, 238.75, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [360.5, 0.0, 323.5, 0.0, 0.0, 361.25, 239.5, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: False
---
"""
OPENCV_YAML = """\
%YAML:1.0
---
calibration_time: "Tue 03 Nov 2026 10:11:12 AM UTC"
nframes: 25
image_width: 640
image_height: 480
board_width: 9
board_height: 6
square_size: 2.5000000372529030e-02
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 3.8525000000000000e+02, 0., 3.2225000000000000e+02, 0.,
       3.8650000000000000e+02, 2.3875000000000000e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -2.1000000000000000e-01, 6.0000000000000000e-02,
       4.0000000000000000e-04, -3.0000000000000000e-04, 0. ]
avg_reprojection_error: 2.1345678901234567e-01
"""
OPENCV_XML = """\
<?xml version="1.0"?>
<opencv_storage>
<calibration_time>"Tue 03 Nov 2026 10:11:12 AM UTC"</calibration_time>
<nr_of_frames>25</nr_of_frames>
<image_width>640</image_width>
<image_height>480</image_height>
<board_width>9</board_width>
<fisheye_model>0</fisheye_model>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    3.8525000000000000e+02 0. 3.2225000000000000e+02 0.
    3.8650000000000000e+02 2.3875000000000000e+02 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>5</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    -2.1000000000000000e-01 6.0000000000000000e-02
    4.0000000000000000e-04 -3.0000000000000000e-04 0.</data></distortion_coefficients>
<!-- flags: none -->
</opencv_storage>
"""
OPENCV_JSON = """\
{
    "image_width": 640,
    "image_height": 480,
    "camera_matrix": {
        "type_id": "opencv-matrix",
        "rows": 3,
        "cols": 3,
        "dt": "d",
        "data": [ 385.25, 0.0, 322.25, 0.0, 386.5, 238.75, 0.0, 0.0, 1.0 ]
    },
    "distortion_coefficients": {
        "type_id": "opencv-matrix",
        "rows": 1,
        "cols": 5,
        "dt": "d",
        "data": [ -0.21, 0.06, 0.0004, -0.0003, 0.0 ]
    }
}
"""
CAMCHAIN = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.21, 0.06, 0.0004, -0.0003]
  distortion_model: radtan
  intrinsics: [385.25, 386.5, 322.25, 238.75]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.99998, 0.0021, 0.0042, -0.110]
  - [-0.0022, 0.9999, 0.0251, 0.0004]
  - [-0.0042, -0.0251, 0.9996, -0.0006]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [0.012, -0.0025, 0.0007, -0.0001]
  distortion_model: equidistant
  intrinsics: [190.5, 190.75, 318.25, 241.5]
  resolution: [640, 480]
  rostopic: /cam1/image_raw
cam2:
  camera_model: omni
  intrinsics: [0.80065662, 833.006, 830.345, 373.850, 253.749]
  distortion_model: radtan
  distortion_coeffs: [-0.335, 0.132, 0.0006, 0.0006]
  resolution: [640, 480]
"""
EUROC = """\
sensor_type: camera
comment: VI-Sensor cam0
rate_hz: 20
resolution: [640, 480]
camera_model: pinhole
intrinsics: [385.25, 386.5, 322.25, 238.75]
distortion_model: radial-tangential
distortion_coefficients: [-0.21, 0.06, 0.0004, -0.0003]
"""
COLMAP_HEAD = """\
# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
# Number of cameras: 1
"""
COLMAP = f'{COLMAP_HEAD}1 OPENCV 640 480 385.25 386.5 322.75 239.25 -0.21 0.06 0.0004 -0.0003\n'
TRANSFORMS = """\
{
    "camera_model": "OPENCV",
    "fl_x": 385.25,
    "fl_y": 386.5,
    "cx": 322.75,
    "cy": 239.25,
    "w": 640,
    "h": 480,
    "k1": -0.21,
    "k2": 0.06,
    "p1": 0.0004,
    "p2": -0.0003,
    "aabb_scale": 16,
    "frames": [
        {
            "file_path": "images/frame_00001.jpg",
            "transform_matrix": [
                [1.0, 0.0, 0.0, 0.0],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0]
            ],
            "colmap_im_id": 1
        },
        {"file_path": "images/frame_00002.jpg", "transform_matrix": []}
    ]
}
"""
# Of the one camera above, by what the program is called.
FILES = {
    'ost.yaml': OST_YAML,
    'ost.txt': OST_TXT,
    'ros2 topic echo': ECHO,
    'ros2 topic echo, for a while': ECHO + ECHO.replace('123456789', '223456789') + ECHO[:150],
    'rostopic echo': ECHO_ROS1,
    'OpenCV YAML': OPENCV_YAML,
    'OpenCV XML': OPENCV_XML,
    'OpenCV JSON': OPENCV_JSON,
    'Kalibr': CAMCHAIN[: CAMCHAIN.index('cam1:')],
    'EuRoC': EUROC,
}
