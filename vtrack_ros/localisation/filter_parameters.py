"""Parameter tables that trackers, or a tracker and the replica of its paper, have in common."""

from vtrack_ros.appearance.siamese_network import read_backbone, read_head
from vtrack_ros.localisation.presence import DEFAULT_THRESHOLD
from vtrack_ros.parameters import Parameter, ParameterTable

#: Parameters of everything that localises a target.
PRESENCE = ParameterTable([
    Parameter('confidence_threshold', DEFAULT_THRESHOLD, 'Minimum confidence for the state '
              'tracking, in which the pose is published. A larger value gives fewer wrong boxes, '
              'but more frames without a box.', 0.01, 0.99),
])
#: Parameters of every filter on top of a localiser.
LOCALISER = PRESENCE + ParameterTable([
    Parameter('localiser', 'dcf', 'How the target is found in the image. dcf: by correlation '
              'filters trained on it; siamese: by a Siamese network, loaded from siamese.backbone '
              'and siamese.head (docs/localisers.md). A change keeps the target.',
              choices=('dcf', 'siamese')),
    Parameter('siamese.backbone', '', "ONNX file of the Siamese network's backbone, with the "
              'inputs and outputs of NanoTrack V2; needed if localiser is siamese.',
              check=read_backbone),
    Parameter('siamese.head', '', "ONNX file of the Siamese network's head, with the inputs and "
              'outputs of NanoTrack V2; needed if localiser is siamese.', check=read_head),
])
#: Parameters of a particle filter over boxes.
MOTION = ParameterTable([
    Parameter('particles', 150, 'Number of particles; more take more time per frame.', 2, 5000),
    Parameter('acceleration', 0.2, 'Process noise: standard deviation of the change of velocity '
              'per frame, as a fraction of the target size sqrt(width * height). A larger value '
              'spreads the particles wider.', 0.001, 2.0),
])
RESAMPLING = ParameterTable([
    Parameter('threshold', 1.0, 'Resample when the effective sample size falls below this '
              'fraction of the number of particles; 0: never.', 0.0, 1.0),
])
WEIGHTING = ParameterTable([
    Parameter('weighting', 'simplified', 'How the particles are weighted. simplified: by the '
              'likelihood; full: by the likelihood times the ratio of transition prior and '
              'proposal density.', choices=('simplified', 'full')),
])

#: Parameters of the particles that accompany mean shift.
MEAN_SHIFT_PARTICLES = ParameterTable([
    Parameter('particles', 20, 'Number of particles; more take more time per frame.', 1, 2000),
    Parameter('accepted', 0.8, "Similarity threshold th: mean shift's result is used if its "
              'similarity is at least th, otherwise the best particle.', 0.0, 1.0),
    Parameter('region', 0.5, 'Size of the rectangle about the forecast in which the particles '
              "are drawn uniformly, relative to the target's box. A larger value covers faster "
              'motion, but less densely.', 0.0, 5.0),
    Parameter('inertia', 0.5, 'Fraction of the current velocity that the forecast uses; 0: the '
              'target stands still, 1: constant velocity.', 0.0, 1.0),
])

#: The parameters of the noise of affine frames, in the order of `affine.from_coordinates`.
AFFINE_NOISES = ParameterTable(
    Parameter(name, default, f'Process noise: standard deviation per frame of {change}.', 0.0,
              high, unit='rad' if name == 'rotation_noise' else '')
    for name, default, change, high in (
        ('scale_noise', 0.02, 'the relative change of scale', 0.5),
        ('aspect_noise', 0.005, 'half the relative change of the aspect ratio', 0.5),
        ('rotation_noise', 0.02, 'the rotation', 1.5),
        ('skew_noise', 0.005, 'the change of skew (ppca_paper: of its direction, in rad)', 0.5),
        ('x_noise', 0.06, 'the step along x, as a fraction of the target size '
         'sqrt(width * height)', 2.0),
        ('y_noise', 0.06, 'the step along y, as a fraction of the target size '
         'sqrt(width * height)', 2.0)))
#: Parameters of a particle filter over affine frames, and of its dynamics on the group.
AFFINE = ParameterTable([
    Parameter('particles', 400, 'Number of particles; more take more time per frame.', 2, 5000),
    *AFFINE_NOISES.values(),
    Parameter('subspace_sigma', 0.05, 'Width sigma of the subspace likelihood '
              'exp(-e / (2 sigma^2)), where e is the robust reconstruction error from 0 to 1. A '
              'larger value weights the particles more equally.', 0.005, 1.0),
    Parameter('eigenvectors', 16, "Maximum number of principal components of the target's "
              'appearance subspace.', 1, 64),
    Parameter('forgetting', 0.95, 'Forgetting factor of the subspace: factor by which the weight '
              'of earlier patches is multiplied at each update; 1 forgets nothing.', 0.5, 1.0),
    Parameter('update_interval', 5, 'Number of frames between updates of the subspace; in appf, '
              'frames in which the target is out of sight or uncertain do not count.', 1, 100,
              unit='frames'),
])
AFFINE_GROUP = ParameterTable([
    Parameter('ar', 0.5, 'Coefficient a of the autoregressive process: fraction of the last '
              'step that is repeated; 0: random walk, 1: constant velocity.', 0.0, 1.0),
    Parameter('colour_sigma', 0.12, 'Width sigma of the colour likelihood '
              'exp(-(1 - rho) / (2 sigma^2)), where rho is the Bhattacharyya coefficient of the '
              'colour histograms. A larger value weights the particles more equally.',
              0.01, 1.0),
])
