"""The security policy is exactly what the nodes use; and no input is ever executed."""

import ast
from importlib.util import find_spec
import xml.etree.ElementTree as ElementTree

from node_harness import Client, NodeProcess
import pytest

#: Calls that execute, or may execute, their argument.
DANGEROUS_CALLS = {'eval', 'exec', 'compile', '__import__', 'os.system', 'os.popen', 'yaml.load',
                   'yaml.load_all', 'yaml.full_load', 'yaml.unsafe_load', 'joblib.load'}
DANGEROUS_MODULES = {'pickle', 'cPickle', 'dill', 'cloudpickle', 'marshal', 'shelve', 'code'}


def allowed(repository, namespace):
    """Return the names that the policy allows a node in a namespace: permission -> names."""
    root = ElementTree.parse(repository / 'config' / 'tracker.policy.xml').getroot()
    profile, = root.iter('profile')
    assert (profile.get('ns'), profile.get('node')) == ('/', 'tracker')
    found = {}
    for group in profile:
        (what, rule), = group.attrib.items()
        assert rule == 'ALLOW'
        found[what] = {_resolved(one.text, namespace) for one in group}
    return found


def _resolved(name, namespace):
    if name.startswith('/'):
        return name
    return name.replace('~', f'{namespace}/tracker', 1) if name[0] == '~' else (
        f'{namespace}/{name}')


def test_policy_is_what_the_nodes_do(repository):
    """Plain and lifecycle node, with all optional topics, use exactly the names it allows."""
    policy = allowed(repository, '/robot')
    if find_spec('tf2_msgs') is None:
        # Without tf2_msgs the node publishes no transform.
        policy['publish'].remove('/tf')
    used = {what: set() for what in policy}
    settings = {'init_from_detections': True, 'target_frame': 'target', 'use_sim_time': True}
    with NodeProcess('-r', '__ns:=/robot', **settings), Client('/robot/tracker') as client:
        client.ready()
        look(client, used, {'subscribe': {'/robot/image'}})
    with NodeProcess('-r', '__ns:=/robot', '-r', '__node:=tracker', entry='lifecycle_main',
                     image_transport='compressed', **settings), (
            Client('/robot/tracker', publish=None)) as client:
        from lifecycle_msgs.srv import ChangeState
        assert client.parameters.wait_for_services(20)
        for transition in (1, 3):
            request = ChangeState.Request()
            request.transition.id = transition
            caller = client.node.create_client(ChangeState, '/robot/tracker/change_state')
            assert caller.wait_for_service(20)
            assert client.call(caller.call_async(request)).success
        look(client, used, policy)
    assert used == policy


def look(client, used, wanted):
    """Add the names that `/robot/tracker` uses, by the graph, until all `wanted` are there."""
    node = client.node

    def complete():
        if ('tracker', '/robot') not in node.get_node_names_and_namespaces():
            return False
        for what, names in (('subscribe', node.get_subscriber_names_and_types_by_node),
                            ('publish', node.get_publisher_names_and_types_by_node),
                            ('reply', node.get_service_names_and_types_by_node)):
            used[what] |= {name for name, _ in names('tracker', '/robot')}
        return all(used[what] >= names for what, names in wanted.items())
    client.until(complete, 'the node lacks some of what the policy allows')


@pytest.mark.lint
def test_nothing_is_executed(repository):
    """No code of the package evaluates text, or reads a format that can hold code."""
    found = []
    for path in sorted([*(repository / 'vtrack_ros').rglob('*.py'),
                        *(repository / 'launch').glob('*.py')]):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            for word in dangers(node):
                found.append(f'{path.relative_to(repository)}:{node.lineno}: {word}')
    assert found == []


def dangers(node):
    """Return the dangerous modules, calls and arguments of a syntax node."""
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        names = [alias.name for alias in node.names]
        names += [node.module or ''] if isinstance(node, ast.ImportFrom) else []
        return [name for name in names if name.partition('.')[0] in DANGEROUS_MODULES]
    if not isinstance(node, ast.Call):
        return []
    name = ast.unparse(node.func)
    return [name] * (name in DANGEROUS_CALLS) + [
        f'{name}({one.arg}=...)' for one in node.keywords if one.arg in ('shell', 'allow_pickle')]
