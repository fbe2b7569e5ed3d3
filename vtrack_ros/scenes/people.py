"""Scenes with people on foot: occlusion, look-alikes, leaving and coming back."""

import numpy as np

from vtrack_ros.frame import Array
from vtrack_ros.scenes import outdoor
from vtrack_ros.scenes.canvas import Canvas, masonry
from vtrack_ros.scenes.figure import Person, walker
from vtrack_ros.scenes.outdoor import Ground
from vtrack_ros.scenes.sprite import keyframes, Placement, Sprite, unrest
from vtrack_ros.scenes.stage import Actor, FilmCamera, Light, Scene, View


def handheld(rng: np.random.Generator, amount: float) -> FilmCamera:
    """Return a hand-held camera that shakes by an amount, in world units."""
    x, y, turn = unrest(rng, amount, 30), unrest(rng, amount, 24), unrest(rng, 0.002 * amount, 40)
    return FilmCamera(lambda time: Placement(x(time), y(time), 1.0, turn(time)))


def kiosk(view: View, width: float, height: float, rng: np.random.Generator) -> Sprite:
    """Return a brick kiosk with a poster and a shutter, to walk behind."""
    canvas = Canvas(0, 0, width, height, view.unit)
    canvas.picture[:] = masonry(canvas.shape, view.unit, rng, (88, 104, 136), (9, 4))
    canvas.gain(1.1 - 0.3 * canvas.columns() / width)
    canvas.rectangle(0, 0, width, 5, (70, 74, 80))
    canvas.rectangle(0.1 * width, 0.2 * height, 0.48 * width, 0.72 * height, (60, 64, 70))
    canvas.rectangle(0.13 * width, 0.22 * height, 0.45 * width, 0.7 * height, (70, 60, 150))
    canvas.ellipse(0.29 * width, 0.42 * height, 0.2 * width, 0.2 * height, (130, 160, 200))
    for row in np.arange(0.25, 0.85, 0.05):
        canvas.rectangle(0.56 * width, row * height, 0.92 * width, (row + 0.034) * height,
                         (128, 134, 138))
    return canvas.upright()


def full_occlusion(view: View, rng: np.random.Generator) -> Scene:
    """Return a walker who disappears behind a kiosk and comes out on its other side."""
    ground = Ground(70, 0.0062, 160)
    backdrop = outdoor.park(view, ground, rng.spawn(1)[0])
    target = Person(view.unit, rng, shirt=(50, 50, 165), trousers=(95, 70, 55))
    other = Person(view.unit, rng, shirt=(150, 140, 70), trousers=(60, 66, 76))
    wobble = unrest(rng, 1.2, 30)
    x = keyframes((0, 40), (40, 108), (62, 152), (84, 196), (110, 250), (140, 282))
    shade, walk = walker(target, ground, x, lambda time: 176 + wobble(time), 140)
    back = keyframes((0, 270), (140, 40))
    other_shade, passer = walker(other, ground, back, lambda time: 140, 140, phase=0.3)
    booth = kiosk(view, 62, 104, rng.spawn(1)[0])
    return Scene(view, backdrop, (
        other_shade, passer, shade, walk,
        Actor(lambda time: Placement(160, 196), lambda time: booth)), 3, handheld(rng, 0.8))


def similar_occlusion(view: View, rng: np.random.Generator) -> Scene:
    """Return a walker who stops and goes on, and is then covered by somebody dressed alike."""
    ground = Ground(90, 0.0064, 192)
    backdrop = outdoor.arcade(view, ground, rng.spawn(1)[0])
    target = Person(view.unit * 1.2, rng, shirt=(58, 58, 150), trousers=(88, 76, 66))
    alike = Person(view.unit * 1.3, rng, shirt=(62, 60, 156), trousers=(80, 72, 66),
                   hair=(30, 34, 44))
    third = Person(view.unit, rng, shirt=(120, 130, 90), trousers=(70, 74, 84))
    tremor = unrest(rng, 0.8, 35)
    x = keyframes((0, 60), (55, 140), (78, 146), (95, 164), (125, 196), (170, 262))
    y = keyframes((0, 214), (55, 222), (125, 224), (170, 216))
    shade, walk = walker(target, ground, x, lambda time: y(time) + tremor(time), 170)
    front = keyframes((0, 410), (60, 330), (99, 200), (108, 182), (120, 172), (140, 110),
                      (170, 30))
    near = keyframes((0, 244), (99, 239), (120, 240), (170, 252))
    front_shade, occluder = walker(alike, ground, front, near, 170, phase=0.4)
    back = keyframes((0, 20), (170, 330))
    back_shade, passer = walker(third, ground, back, lambda time: 180, 170)
    return Scene(view, backdrop, (back_shade, passer, shade, walk, front_shade, occluder), 3,
                 FilmCamera(noise=4))


def football(view: View, rng: np.random.Generator) -> Scene:
    """Return a player among players: half covered in frames 58 to 77, in shade from 85 on."""
    ground = Ground(20, 0.005, 200)
    backdrop = outdoor.pitch(view, ground, rng.spawn(1)[0])
    team = [Person(view.unit, rng, shirt=(170, 70, 40), stripe=(215, 215, 215), upright=True,
                   trousers=(205, 205, 205), shorts=True, socks=(190, 185, 180), sleeves=False)
            for _ in range(3)]
    rivals = [Person(view.unit, rng, shirt=(50, 45, 175), trousers=(40, 40, 45), shorts=True,
                     socks=(50, 45, 150), sleeves=False) for _ in range(3)]
    referee = Person(view.unit, rng, shirt=(45, 45, 45), trousers=(40, 40, 40), shorts=True,
                     socks=(40, 40, 40), sleeves=False)
    veer = [unrest(rng, 1.5, 24) for _ in range(6)]
    x = keyframes((0, 60), (30, 128), (55, 184), (66, 200), (76, 208), (100, 262), (125, 300),
                  (150, 282))
    y = keyframes((0, 150), (55, 160), (76, 162), (110, 148), (150, 168))

    def run(person: Person, path: tuple[tuple[float, float], ...],
            depth: tuple[tuple[float, float], ...], which: int,
            phase: float) -> tuple[Actor, Actor]:
        across, away = keyframes(*path), keyframes(*depth)
        return walker(person, ground, lambda time: across(time) + veer[which](time), away, 150,
                      stride=1.4, phase=phase)

    target = walker(team[0], ground, x, y, 150, stride=1.4)
    behind = (
        *run(rivals[2], ((0, 330), (70, 250), (150, 130)), ((0, 96), (150, 108)), 0, 0.2),
        *run(team[2], ((0, 20), (80, 150), (150, 250)), ((0, 112), (150, 120)), 1, 0.7),
        *run(referee, ((0, 240), (60, 280), (150, 330)), ((0, 124), (150, 118)), 2, 0.5))
    front = (
        *run(rivals[0], ((0, 330), (40, 262), (58, 194), (66, 202), (74, 207), (84, 196),
                         (150, 60)), ((0, 190), (56, 170), (76, 169), (150, 200)), 3, 0.1),
        *run(team[1], ((0, 390), (50, 268), (62, 226), (74, 196), (90, 150), (150, 20)),
             ((0, 170), (62, 172), (74, 173), (150, 190)), 4, 0.6),
        *run(rivals[1], ((0, 175), (60, 270), (120, 350), (150, 420)), ((0, 214), (150, 206)), 5,
             0.3))
    pan = keyframes((0, -24), (60, 4), (110, 30), (150, 30))
    shake = unrest(rng, 0.7, 26)
    gloom = keyframes((0, 1.06), (82, 1.04), (100, 0.6), (150, 0.56))

    def shaded(time: float, at_x: Array, at_y: Array) -> Array:
        """Lay the grandstand's shadow over the right side of the pitch."""
        edge = (at_x + pan(time) - 285 - 0.25 * (at_y - 120)) / 6
        return np.asarray(1 - 0.36 / (1 + np.exp(-np.clip(edge, -30, 30))))

    light = Light(lambda time: (gloom(time) * 1.04, gloom(time), gloom(time) * 0.95), shaded)
    return Scene(view, backdrop, (*behind, *target, *front), len(behind) + 1,
                 FilmCamera(lambda time: Placement(pan(time), shake(time)), noise=4), light)


def distractor_cross(view: View, rng: np.random.Generator) -> Scene:
    """Return two people dressed alike who pass each other twice, in front and behind."""
    ground = Ground(70, 0.0066, 160)
    backdrop = outdoor.park(view, ground, rng.spawn(1)[0])
    target, double = (
        Person(view.unit * 1.1, rng, shirt=(150, 90, 50), stripe=(190, 190, 180),
               trousers=(60, 64, 72)) for _ in range(2))
    other = Person(view.unit, rng, shirt=(60, 120, 170), trousers=(90, 70, 60))
    bob = unrest(rng, 1.0, 40)
    x = keyframes((0, 52), (45, 150), (70, 214), (78, 216), (104, 150), (130, 80))
    y = keyframes((0, 176), (70, 180), (104, 198), (130, 200))
    shade, walk = walker(target, ground, x, lambda time: y(time) + 0.5 * bob(time), 130)
    cross = keyframes((0, 268), (45, 160), (66, 104), (74, 104), (100, 148), (130, 226))
    deep = keyframes((0, 192), (45, 190), (100, 184), (130, 176))
    double_shade, passer = walker(double, ground, cross, deep, 130, phase=0.5)
    far = walker(other, ground, keyframes((0, 300), (130, 120)), lambda time: 134, 130)
    # The nearer person must be drawn last; the order changes at frame 72, when they are far apart.
    away = Placement(-4000, -4000)
    before = Actor(lambda time: passer.placement(time) if time < 72 else away, passer.sprite)
    after = Actor(lambda time: passer.placement(time) if time >= 72 else away, passer.sprite)
    return Scene(view, backdrop, (*far, double_shade, after, shade, walk, before), 5,
                 handheld(rng, 1.0))


def leave_and_return(view: View, rng: np.random.Generator) -> Scene:
    """Return a walker who leaves the image to the right and comes back there 40 frames later."""
    ground = Ground(75, 0.0068, 160)
    backdrop = outdoor.arcade(view, ground, rng.spawn(1)[0])
    target = Person(view.unit * 1.2, rng, shirt=(60, 140, 190), stripe=(50, 60, 70),
                    trousers=(110, 76, 50))
    one = Person(view.unit, rng, shirt=(70, 80, 140), trousers=(60, 60, 66))
    two = Person(view.unit * 1.2, rng, shirt=(130, 128, 120), trousers=(80, 90, 110))
    out = view.right + 30
    x = keyframes((0, 100), (30, 190), (60, out), (85, out), (115, 200), (150, 110), (170, 90))
    y = keyframes((0, 196), (60, 192), (85, 190), (170, 204))
    shade, walk = walker(target, ground, x, y, 170)
    far = walker(one, ground, keyframes((0, 40), (170, 300)), lambda time: 152, 170)
    near = walker(two, ground, keyframes((0, view.right + 30), (20, view.right + 30),
                                         (110, view.left - 30), (170, view.left - 30)),
                  lambda time: 176, 170, phase=0.3)
    return Scene(view, backdrop, (*far, *near, shade, walk), 5, handheld(rng, 0.7))


def scale_change(view: View, rng: np.random.Generator) -> Scene:
    """Return a walker who comes towards the camera, turns round, and goes away again."""
    ground = Ground(70, 0.0068, 160)
    backdrop = outdoor.park(view, ground, rng.spawn(1)[0])
    target = Person(view.unit * 1.5, rng, shirt=(150, 150, 60), stripe=(90, 60, 40),
                    trousers=(64, 74, 96))
    other = Person(view.unit, rng, shirt=(130, 130, 70), trousers=(64, 70, 80))
    x = keyframes((0, 220), (40, 196), (75, 150), (90, 146), (130, 104), (160, 92))
    y = keyframes((0, 134), (40, 172), (75, 246), (88, 250), (130, 160), (160, 122))
    shade, walk = walker(target, ground, x, y, 160)
    far = walker(other, ground, keyframes((0, 60), (160, 280)), lambda time: 128, 160)
    return Scene(view, backdrop, (*far, shade, walk), 3, handheld(rng, 1.1))


def low_light_noise(view: View, rng: np.random.Generator) -> Scene:
    """Return a walker at night, between the light of lamps, filmed by a dark and noisy camera."""
    ground = Ground(75, 0.0068, 160)
    backdrop = outdoor.arcade(view, ground, rng.spawn(1)[0])
    target = Person(view.unit * 1.2, rng, shirt=(70, 120, 150), trousers=(90, 80, 70))
    other = Person(view.unit * 1.2, rng, shirt=(110, 100, 90), trousers=(60, 60, 64))
    sway = unrest(rng, 1.5, 30)
    x = keyframes((0, 60), (50, 150), (70, 166), (100, 230), (130, 250))
    y = keyframes((0, 186), (70, 196), (130, 188))
    shade, walk = walker(target, ground, x, lambda time: y(time) + sway(time), 130)
    near = walker(other, ground, keyframes((0, 290), (130, 30)), lambda time: 166, 130, phase=0.4)
    glare = keyframes((0, 0), (72, 0), (82, 1), (94, 0), (130, 0))

    def lamps(time: float, at_x: Array, at_y: Array) -> Array:
        """Light two places below lamps, and let the lights of a car pass."""
        pools = sum(np.exp(-((at_x - place) / 52) ** 2 - ((at_y - 150) / 90) ** 2)
                    for place in (40, 215))
        beam = glare(time) * np.exp(-((at_x - 40 - 12 * (time - 72)) / 70) ** 2)
        return np.asarray(0.24 + 0.3 * pools + 0.35 * beam + 0 * at_y)

    return Scene(view, backdrop, (*near, shade, walk), 3,
                 FilmCamera(exposure=0.9, noise=17, softness=0.6),
                 Light(lambda time: (0.9, 1.0, 1.12), lamps))
