"""The stand-in for the robot: listens to velocity commands, publishes odometry and the truth."""

import time

from geometry_msgs.msg import TransformStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.nodes.common import topics
from cmpsp_ros.nodes.common.messages import BASE, cloud_of, path_of, set_pose, set_stamp
from cmpsp_ros.nodes.common.parameters import declare, event_of
from cmpsp_ros.nodes.common.runtime import run
from cmpsp_ros.nodes.common.topic import Topic
from cmpsp_ros.nodes.sim.pace import Lockstep, RealTime
from cmpsp_ros.nodes.sim.surroundings import Pedestrians, Scanner, Traffic
from cmpsp_ros.parameters import TABLE, ParameterError, Values, check_simulation, plant_settings
from cmpsp_ros.programs import quick_exit
from cmpsp_ros.robots.motion import with_side
from cmpsp_ros.simulator import Motion, OdometrySchedule, Plant, TwistError

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # tf2 is not among the wheels
    TFMessage = None


class SimNode(Node):
    """The robot on ROS topics; its time is paced by `RealTime` or by `Lockstep`."""

    def __init__(self) -> None:
        super().__init__('sim')
        self.values: Values = declare(self, 'sim')
        settings = plant_settings(self.values)
        check_simulation(self.values)
        has_clock = self.values['publish_clock']
        self.odometry = topics.SIM_ODOM.publish_on(self)
        self._traffic = Traffic(self.values)
        self._moving = topics.SIM_MOVING.publish_on(self) if len(self._traffic) else None
        tells = self.values['road.source'] == 'topic'
        self._road = topics.SIM_ROAD.publish_on(self) if tells else None
        self._tell_road()
        # Of the topics of a run that with the most messages.
        self._truth, self.published = topics.TRUTH.publish_on(self), 0
        self._wheels = topics.SIM_WHEELS.publish_on(self)
        self._clock_out = topics.CLOCK.publish_on(self) if has_clock else None
        # As a broadcaster of tf2_ros; without the message RViz shows the course alone.
        self._transforms = (
            None if TFMessage is None else self.create_publisher(TFMessage, '/tf', 100)
        )
        if TFMessage is None:
            self.get_logger().info('tf2_msgs is not installed: no transforms on /tf')

        # The first motion compiles the kinematics, which must not count as time that passes.
        _ = Plant(settings).motion
        offset_ns = self._clock_offset_ns = round(self.values['clock_offset'] * NANOSECONDS)
        # No stamp is negative, and neither is the time on /clock.
        begin_ns = max(0, offset_ns) if has_clock else time.time_ns() + offset_ns
        self.instants = OdometrySchedule(settings, begin_ns)
        self.measured_ns = begin_ns
        self.plant = Plant(settings, begin_ns)
        self._moves_sideways = settings.robot.twist_parts > 2
        self._people = Pedestrians(self)
        self._scanner = (
            Scanner(self, self._traffic, self._people) if self.values['sim.scan.rate'] else None
        )
        self._tell_scanner()
        self._pace = Lockstep(self) if self.values['lockstep'] else RealTime(self)
        if self.values['enable_stamped_cmd_vel']:
            topics.SIM_STAMPED_COMMAND.listen_on(self, self._on_stamped)
        else:
            topics.SIM_COMMAND.listen_on(self, self._pace.hear)
        self.create_service(topics.SIM_RESET.type, topics.SIM_RESET.name, self._on_reset)
        self.add_on_set_parameters_callback(self._on_parameters)
        parameters = topics.SIM_PARAMETERS.publish_on(self)
        parameters.publish(event_of(self))
        self.add_post_set_parameters_callback(
            lambda changed: parameters.publish(event_of(self, changed))
        )

    def run_to(self, stamp_ns: int) -> Odometry | None:
        """Drive on, publish everything due, and return the last odometry, if due and not lost."""
        message = None
        while (due_ns := self.instants.next_ns) <= stamp_ns:
            self._drive_to(due_ns)
            self.measured_ns, message = due_ns, self.measure()
            self.publish(message)
            self.instants.advance()
        self._drive_to(stamp_ns)
        return message

    def obey(self, twist: Twist) -> None:
        """Command the robot now; a twist that is not finite changes nothing."""
        stamp_ns = self.plant.stamp_ns
        self._traffic.begin(stamp_ns)
        self._people.begin(stamp_ns)
        try:
            wanted = twist.linear.x, twist.linear.y, twist.angular.z
            self.plant.command(stamp_ns, *(wanted if self._moves_sideways else wanted[::2]))
        except TwistError as error:
            self.get_logger().warning(f'cmd_vel refused: {error}', throttle_duration_sec=2.0)
        self._drive_to(stamp_ns)

    def measure(self) -> Odometry | None:
        """Odometry of this instant, with its errors; None if it is lost."""
        pose = self.plant.measure()
        if pose is None:
            return None
        message = self._odometry(self.plant.stamp_ns, pose, self.plant.twist)
        message.pose.covariance[0] = float(self.values['noise.position_stddev'] ** 2)
        message.pose.covariance[7] = message.pose.covariance[0]
        message.pose.covariance[35] = float(self.values['noise.heading_stddev'] ** 2)
        return message

    def publish(self, message: Odometry | None) -> None:
        """Publish odometry, if any, after all that decisions on it use; then the truth."""
        stamp_ns = self.plant.stamp_ns
        if self._clock_out is not None:
            now = Time(nanoseconds=stamp_ns - self._clock_offset_ns).to_msg()
            self._clock_out.publish(ClockMessage(clock=now))
        if self._moving is not None:
            tracks = self._traffic.at(stamp_ns)
            self._moving.publish(cloud_of(tracks, stamp_ns, self.values['frame_id']))
        self._people.publish(stamp_ns)
        if self._scanner is not None:
            self._scanner.publish(stamp_ns)
        if message is not None:
            self.odometry.publish(message)
            if self._transforms is not None:
                self._transforms.publish(TFMessage(transforms=[_transform(message)]))
        self._publish_truth(self.plant.motion)

    def _tell_road(self) -> None:
        if self._road is not None and self.values['road.points']:
            self._road.publish(path_of(self.values))

    def _tell_scanner(self) -> None:
        if self._scanner is not None and TFMessage is not None:
            topic = Topic('sim', 'out', '/tf_static', TFMessage, '', depth=1, latched=True)
            self._static = topic.publish_on(self)
            there = self._scanner.transform(self.plant.stamp_ns)
            self._static.publish(TFMessage(transforms=[there]))

    def _drive_to(self, stamp_ns: int) -> None:
        changes = self.plant.advance(stamp_ns)
        for change in changes:
            self._publish_truth(change)
        if self._scanner is not None:
            self._scanner.note(*changes, self.plant.motion)
        self._people.advance(stamp_ns, self.plant.pose)

    def _publish_truth(self, motion: Motion) -> None:
        # Nobody but who records or looks on listens, and it would be half of this node's work.
        if not self._truth.get_subscription_count() + self._wheels.get_subscription_count():
            return
        message = self._odometry(motion.stamp_ns, motion.pose, motion.twist)
        self._truth.publish(message)
        self.published += 1
        wheels = JointState(header=message.header, name=self.values['robot.joint_names'])
        wheels.velocity = motion.wheel_speeds.tolist()
        self._wheels.publish(wheels)

    def _odometry(self, stamp_ns: int, pose: Array, twist: Array) -> Odometry:
        message = Odometry(child_frame_id=BASE)
        set_stamp(message.header, stamp_ns)
        message.header.frame_id = self.values['frame_id']
        set_pose(message.pose.pose, pose.tolist())
        forward, left, turn_rate = with_side(twist).tolist()
        message.twist.twist.linear.x, message.twist.twist.linear.y = forward, left
        message.twist.twist.angular.z = turn_rate
        return message

    def _on_stamped(self, message: TwistStamped) -> None:
        self._pace.hear(message.twist, Time.from_msg(message.header.stamp).nanoseconds)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._pace.before_reset()
        self.plant.reset()
        self._traffic.reset()
        self._people.reset()
        if self._scanner is not None:
            self._scanner.reset(self.plant.motion)
        self._publish_truth(self.plant.motion)
        self._pace.after_reset()
        response.success = True
        response.message = (
            f'at the initial pose, at rest; time is {self.plant.stamp_ns / NANOSECONDS} s'
        )
        return response

    def _on_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        changes = {each.name: each.value for each in parameters}
        try:
            values = TABLE.reconfigure(self.values, changes)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._pace.before_reset()
        self.plant.reconfigure(plant_settings(values))
        before, self.values = self.values, values
        if self._scanner is not None:
            self._scanner.look_around(values)
            self._scanner.note(self.plant.motion)
        if any(values[key] != before[key] for key in ('road.points', 'road.closed')):
            self._tell_road()
        return SetParametersResult(successful=True)


def _transform(odometry: Odometry) -> TransformStamped:
    transform = TransformStamped(header=odometry.header, child_frame_id=odometry.child_frame_id)
    position = odometry.pose.pose.position
    transform.transform.translation.x = position.x
    transform.transform.translation.y = position.y
    transform.transform.rotation = odometry.pose.pose.orientation
    return transform


def main() -> None:
    """Run the simulator until a signal."""
    quick_exit(run(SimNode, name='sim', outlasts=1.0))


if __name__ == '__main__':
    main()
