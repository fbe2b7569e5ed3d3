"""
Where one target is in a frame: the engine that every tracker of the product holds.

A `Localiser` is made on the first frame. Then, in each frame, a tracker gets the response about a
place from it, chooses a place (with its filter, its particles, or none), and passes it back::

    frame, place                                        the tracker's decision
         |                                                        |
    SearchWindow      sampled, its features                       |
         |                                                        |
    TargetModel  ->  ResponseMap  ------>  localise()          update()
                                                                  |
          TargetModel updated there; InitialTemplate: its similarity to the first frame
                                                                  |
          has_failed()?  Redetection: search with the TargetSnapshot of before
                                                                  |
          PresenceDetector: confidence, and the time since the target was last seen

`Hypotheses` are two localisers of one target, of which the more credible leads, with the interface
of one. `GuidedSearch` computes responses at the places that forecasts point to, and chooses among
their maxima by motion and response; `Distractors` follows maxima that look like the target, and
aren't. Where the choice is far from what was expected, the target's points, followed by optical
flow, tell whether it went there; they also tell its growth and rotation, and the window turns
along.

`search_window` has the window, `response_map` the response over it, `target_model` the models of
the target (correlation filter, colours, scale), `presence` judges whether it's there, by its
appearance and its `motion_evidence`, `redetection` searches when tracking has failed, in the whole
frame `global_search`; `localiser` composes them.
Beside them, `mean_shift` climbs a response and fuses [Yin2013].
"""

from vtrack_ros.localisation.guided_search import GuidedSearch
from vtrack_ros.localisation.hypotheses import Hypotheses
from vtrack_ros.localisation.localiser import Localiser
from vtrack_ros.localisation.response_map import Found, ResponseMap

__all__ = ['Found', 'GuidedSearch', 'Hypotheses', 'Localiser', 'ResponseMap']
