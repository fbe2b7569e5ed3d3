"""Parameter tables that trackers, or a tracker and the replica of its paper, have in common."""

from vtrack_ros.appearance.siamese_network import check_backbone, check_head
from vtrack_ros.localisation.presence import DEFAULT_THRESHOLD
from vtrack_ros.parameters import Parameter, ParameterTable

#: Parameters of everything that localises a target.
PRESENCE = ParameterTable([
    Parameter('confidence_threshold', DEFAULT_THRESHOLD, 'Least confidence with which the target '
              'is said to be tracked, and its pose is published: more of it means fewer wrong '
              'boxes, and more frames without one.', 0.01, 0.99),
])
#: Parameters of every filter on top of a localiser.
LOCALISER = PRESENCE + ParameterTable([
    Parameter('localiser', 'dcf', 'What answers where the target is: correlation filters that '
              'learn it, or a Siamese network, whose two files are needed (docs/localisers.md); '
              'changing it keeps the target.', choices=('dcf', 'siamese')),
    Parameter('siamese.backbone', '', "ONNX file of the network's backbone, with the inputs and "
              'outputs of NanoTrack V2; empty: none.', check=check_backbone),
    Parameter('siamese.head', '', "ONNX file of the network's head, likewise; empty: none.",
              check=check_head),
])
#: Parameters of a particle filter over boxes.
MOTION = ParameterTable([
    Parameter('particles', 150, 'Number of particles.', 2, 5000),
    Parameter('acceleration', 0.2, 'Standard deviation of the change of velocity a frame, as a '
              "share of the target's mean side.", 0.001, 2.0),
])
RESAMPLING = ParameterTable([
    Parameter('threshold', 1.0, 'Resample when the effective sample size falls below this share '
              'of the particles.', 0.0, 1.0),
])
WEIGHTING = ParameterTable([
    Parameter('weighting', 'simplified', 'Weights by the likelihood alone, or times prior over '
              'proposal.', choices=('simplified', 'full')),
])

#: Parameters of the particles that accompany mean shift.
MEAN_SHIFT_PARTICLES = ParameterTable([
    Parameter('particles', 20, 'Number of particles.', 1, 2000),
    Parameter('accepted', 0.8, 'Similarity th from which mean shift is trusted.', 0.0, 1.0),
    Parameter('region', 0.5, 'Reach of the redrawn particles, in semi-axes of the target.',
              0.0, 5.0),
    Parameter('inertia', 0.5, 'Share of the last step that the motion model expects again.',
              0.0, 1.0),
])

#: The parameters of the noise of affine frames, in the order of `affine.from_coordinates`.
AFFINE_NOISES = ParameterTable(
    Parameter(name, default, f'Standard deviation of the {change}.', 0.0, high,
              unit='rad' if name == 'rotation_noise' else '')
    for name, default, change, high in (
        ('scale_noise', 0.02, 'relative change of scale a frame', 0.5),
        ('aspect_noise', 0.005, 'relative change of aspect ratio a frame', 0.5),
        ('rotation_noise', 0.02, 'rotation a frame', 1.5),
        ('skew_noise', 0.005, 'change of skew a frame', 0.5),
        ('x_noise', 0.06, "step along x a frame, as a share of the target's mean side", 2.0),
        ('y_noise', 0.06, "step along y a frame, as a share of the target's mean side", 2.0)))
#: Parameters of a particle filter over affine frames, and of its dynamics on the group.
AFFINE = ParameterTable([
    Parameter('particles', 400, 'Number of particles.', 2, 5000),
    *AFFINE_NOISES.values(),
    Parameter('subspace_sigma', 0.05, 'Width of the subspace likelihood exp(-e / (2 sigma^2)), e '
              'the robust error from 0 to 1.', 0.005, 1.0),
    Parameter('eigenvectors', 16, "Principal components of the target's patches.", 1, 64),
    Parameter('forgetting', 0.95, 'What the patches before are worth at each update.', 0.5, 1.0),
    Parameter('update_interval', 5, 'Frames between updates of the subspace.', 1, 100,
              unit='frames'),
])
AFFINE_GROUP = ParameterTable([
    Parameter('ar', 0.5, 'Share a of the last step that the autoregressive process repeats.',
              0.0, 1.0),
    Parameter('colour_sigma', 0.12, 'Width of the colour likelihood '
              'exp(-(1 - rho) / (2 sigma^2)).', 0.01, 1.0),
])
