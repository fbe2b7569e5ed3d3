"""Pictures."""
def draw_run(bag, topic, frames, truth, out):
    return []
