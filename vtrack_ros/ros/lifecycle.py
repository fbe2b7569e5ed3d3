"""The managed (lifecycle) node, for systems that are brought up in steps."""

from typing import Any

from rclpy.lifecycle import LifecycleNode, State, TransitionCallbackReturn
from rclpy.node import Node

from vtrack_ros.ros.parameter_node import ParameterNode
from vtrack_ros.ros.pipeline import Pipeline


class TrackerLifecycleNode(ParameterNode, LifecycleNode):
    """
    The tracking node under a lifecycle manager.

    Unconfigured, it has only its parameters; configured, its topics and services too; active, it
    takes images. Deactivating keeps the target, cleaning up forgets it.

    The arguments are those of rclpy's node, the errors those of ParameterNode.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__('tracker', **arguments)
        self._pipeline: Pipeline | None = None
        self._log = Node.get_logger(self)
        self._change = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state

    def on_configure(self, state: State) -> TransitionCallbackReturn:
        """Set up topics and services."""
        try:
            self._pipeline = Pipeline(self)
        except Exception as error:
            # rclpy would drop it without a word
            self._log.error(f'not configured: {error}')
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: State) -> TransitionCallbackReturn:
        """Begin to take images."""
        if self._pipeline is not None:
            self._pipeline.activate()
        return super().on_activate(state)

    def on_deactivate(self, state: State) -> TransitionCallbackReturn:
        """Take no more images."""
        if self._pipeline is not None:
            self._pipeline.deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state: State) -> TransitionCallbackReturn:
        """Take everything down, and forget the target; then it can be configured again."""
        if self._pipeline is not None:
            self._pipeline.save(keep=False)
        return self.on_shutdown(state)

    def on_shutdown(self, state: State) -> TransitionCallbackReturn:
        """Take everything down; after an error it can be configured again."""
        if self._pipeline is not None:
            self._pipeline.destroy()
            self._pipeline = None
        return TransitionCallbackReturn.SUCCESS

    on_error = on_shutdown

    def destroy_node(self) -> None:
        """Save the target, and take the node down."""
        if self._pipeline is not None:
            self._pipeline.save()
        super().destroy_node()  # type: ignore[no-untyped-call]

    def _on_change_state(self, request: Any, response: Any) -> Any:
        """Refuse an impossible transition; rclpy raises, and its client would wait for ever."""
        try:
            return self._change(request, response)
        except RuntimeError:
            valid = ', '.join(label for _, label, *_ in self._state_machine.available_transitions)
            self._log.error(
                f'~/change_state refused: transition {request.transition.id} is not possible '
                f'while {self._state_machine.current_state[1]}; '
                + (f'valid are {valid}' if valid else 'no transition is'))
            response.success = False
            return response
