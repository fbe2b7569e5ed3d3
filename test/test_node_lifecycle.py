"""The lifecycle (managed) node: its transitions, and what each of them keeps."""

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from node_harness import Client, diagnosis, NodeProcess, overlap, Scene, STEP
from std_srvs.srv import Trigger

SCENE = Scene()


def change(client, transition):
    """Ask for a transition; return the state after it."""
    answer = client.ask('~/change_state', ChangeState, transition=Transition(id=transition))
    assert answer.success
    return client.ask('~/get_state', GetState).current_state.id


def test_from_unconfigured_to_finalized():
    """Images are only taken while active; deactivating keeps the target, cleaning up doesn't."""
    box = SCENE.box(0)
    init = f'[{box.x}, {box.y}, {box.width}, {box.height}]'
    with NodeProcess(entry='lifecycle_main', init_box=init) as process, Client() as client:
        assert client.parameters.wait_for_services(20)
        assert client.ask('~/get_state', GetState).current_state.id == (
            State.PRIMARY_STATE_UNCONFIGURED)
        assert client.images.get_subscription_count() == 0
        result, = client.change(gmpf__particles=0)
        assert not result.successful
        assert client.change(gmpf__particles=120)[0].successful

        assert change(client, Transition.TRANSITION_CONFIGURE) == State.PRIMARY_STATE_INACTIVE
        client.until(lambda: client.heard['~/state'], 'no state')
        assert client.heard['~/state'][-1].message == 'inactive'
        assert client.images.get_subscription_count() == 0

        assert change(client, Transition.TRANSITION_ACTIVATE) == State.PRIMARY_STATE_ACTIVE
        client.until(lambda: client.images.get_subscription_count(), 'takes no images')
        for index, answer in enumerate(client.play(SCENE, range(5))):
            assert overlap(answer, SCENE.box(index)) > 0.5
        assert client.state_after(answer)['state'] == 'tracking'

        heard = len(client.heard['~/state'])
        assert change(client, Transition.TRANSITION_DEACTIVATE) == State.PRIMARY_STATE_INACTIVE
        client.until(lambda: 'inactive' in [
            one.message for one in client.heard['~/state'][heard:]], 'inactive without a word')
        client.until(lambda: not client.images.get_subscription_count(), 'still takes images')
        assert 'tracking starts on init_box' in process.log
        said = len(process.log)
        assert change(client, Transition.TRANSITION_ACTIVATE) == State.PRIMARY_STATE_ACTIVE
        client.until(lambda: client.images.get_subscription_count(), 'takes no images')
        process.wait_for_log('tracking of the target continues', said)
        # Images that were sent while it was inactive don't count as missing.
        answer = client.send(SCENE.frame(5), 10**9 + 20 * STEP)
        assert overlap(answer, SCENE.box(5)) > 0.4
        assert client.state_after(answer)['frames_missing'] == '0'

        # A new subscriber gets diagnostics of the last second, not of all the time before.
        client.send(SCENE.frame(6), 10**9 + 21 * STEP, 'nonsense', answered=False)
        process.wait_for_log('image dropped')
        heard = len(client.heard['~/state'])
        client.until(lambda: len(client.heard['~/state']) > heard + 2, 'no state')
        client.hear('/diagnostics', DiagnosticArray)
        level, text, values = diagnosis(client, '/tracker: images', lambda *_: True)
        assert 'no image' in text and values['frames malformed'] == '1'

        assert change(client, Transition.TRANSITION_DEACTIVATE) == State.PRIMARY_STATE_INACTIVE
        # init_box was for the stream's first image, which has been.
        assert client.ask('~/reset', Trigger).success
        said = len(process.log)
        assert change(client, Transition.TRANSITION_ACTIVATE) == State.PRIMARY_STATE_ACTIVE
        assert 'init_box in the first' not in process.wait_for_log('select the target', said)
        assert change(client, Transition.TRANSITION_DEACTIVATE) == State.PRIMARY_STATE_INACTIVE
        assert change(client, Transition.TRANSITION_CLEANUP) == State.PRIMARY_STATE_UNCONFIGURED
        client.until(lambda: client.node.count_publishers('/pose') == 0, 'still publishes')
        assert client.change(init_box=[])[0].successful
        assert change(client, Transition.TRANSITION_CONFIGURE) == State.PRIMARY_STATE_INACTIVE
        assert change(client, Transition.TRANSITION_ACTIVATE) == State.PRIMARY_STATE_ACTIVE
        client.until(lambda: client.images.get_subscription_count(), 'takes no images')
        client.until(lambda: client.node.count_publishers('/detections'), 'does not publish')
        assert not client.send(SCENE.frame(6), 10**9 + 22 * STEP).detections
        assert change(client, Transition.TRANSITION_ACTIVE_SHUTDOWN) == (
            State.PRIMARY_STATE_FINALIZED)


def test_transition_that_is_not_possible_is_answered():
    """An impossible transition fails, the log names the valid ones, and these still work."""
    with NodeProcess(entry='lifecycle_main') as process, Client(publish=None) as client:
        assert client.parameters.wait_for_services(20)
        for transition in (Transition.TRANSITION_ACTIVATE, 99):
            answer = client.ask(
                '~/change_state', ChangeState, transition=Transition(id=transition))
            assert not answer.success
        process.wait_for_log('valid are configure, shutdown')
        state = client.ask('~/get_state', GetState).current_state
        assert state.id == State.PRIMARY_STATE_UNCONFIGURED
        assert change(client, Transition.TRANSITION_CONFIGURE) == State.PRIMARY_STATE_INACTIVE
        assert change(client, Transition.TRANSITION_INACTIVE_SHUTDOWN) == (
            State.PRIMARY_STATE_FINALIZED)
        answer = client.ask('~/change_state', ChangeState,
                            transition=Transition(id=Transition.TRANSITION_CONFIGURE))
        assert not answer.success
        process.wait_for_log('is not possible while finalized; no transition is')
