"""The detections of yolo_ros as vision_msgs/Detection2DArray, for the node's ~/init_detections."""

import rclpy
from vision_msgs.msg import Detection2D, Detection2DArray, ObjectHypothesisWithPose


def converted(message):
    """Return a yolo_msgs/DetectionArray as a vision_msgs/Detection2DArray."""
    result = Detection2DArray(header=message.header)
    for one in message.detections:
        detection = Detection2D(header=message.header, id=one.id)
        detection.bbox.center.position.x = one.bbox.center.position.x
        detection.bbox.center.position.y = one.bbox.center.position.y
        detection.bbox.size_x, detection.bbox.size_y = one.bbox.size.x, one.bbox.size.y
        found = ObjectHypothesisWithPose()
        found.hypothesis.class_id, found.hypothesis.score = one.class_name, one.score
        detection.results.append(found)
        result.detections.append(detection)
    return result


def main():
    """Publish on tracker/init_detections what comes on yolo/detections."""
    from yolo_msgs.msg import DetectionArray
    rclpy.init()
    node = rclpy.create_node('yolo_detections')
    publisher = node.create_publisher(Detection2DArray, 'tracker/init_detections', 1)
    node.create_subscription(
        DetectionArray, 'yolo/detections', lambda one: publisher.publish(converted(one)), 1)
    rclpy.spin(node)


if __name__ == '__main__':
    main()
