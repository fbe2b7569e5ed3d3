"""
Where one target is in a frame: the engine that every tracker of the product holds.

A `Localiser` is made on the first frame. Then, in each frame, a tracker asks it for the response
about a place, decides for a place (with its filter, its particles, or none), and gives it back::

    frame, place                                        the tracker's decision
         |                                                        |
    SearchWindow      sampled, described                          |
         |                                                        |
    TargetModel  ->  ResponseMap  ------>  localise()          update()
                                                                  |
          TargetModel updated there; InitialTemplate: its similarity to the first frame
                                                                  |
          has_failed()?  Redetection: search with the TargetSnapshot of before
                                                                  |
          PresenceDetector: confidence, and for how long the target hasn't been seen

`Hypotheses` are two localisers of one target, of which the more credible leads; it's asked and
told like one. `GuidedSearch` asks it at the places that forecasts point to, and chooses among what
it finds by motion and response; `Distractors` are what it finds that looks like the target, and
isn't. Where the choice is far from what was expected, the target's points, followed by optical
flow, tell whether it went there; they tell how it grew and turned, too: the window turns along.

`search_window` has the window and the response over it, `target_model` what is known of the target
(correlation filter, colours, scale), `presence` judges whether it's there, by its look and by its
`motion_evidence`, `redetection` searches when tracking has failed, `localiser` composes them.
Beside them, `mean_shift` climbs a response and fuses [Yin2013].
"""

from vtrack_ros.localisation.candidates import Found
from vtrack_ros.localisation.guided_search import GuidedSearch
from vtrack_ros.localisation.hypotheses import Hypotheses
from vtrack_ros.localisation.localiser import Localiser
from vtrack_ros.localisation.response_map import ResponseMap

__all__ = ['Found', 'GuidedSearch', 'Hypotheses', 'Localiser', 'ResponseMap']
