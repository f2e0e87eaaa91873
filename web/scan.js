// Laser scans: which points of the map they show.

const LASER = 0.1227; // from the rear axle ahead to the laser [m]
export const SAME = 1e-6; // stamps that differ by less are the same [s]
const PLACED = 1; // if two poses are farther apart, the car was placed [m]
const GAP = 0.06; // between poses that are further apart, the car may not drive evenly [s]

/**
 * The pose [x, y, theta] at a stamp [s], between two of the poses {stamp, pose}. Until there is a
 * later pose, it is null: the bridge may leave out the very pose at which a scan was taken. It is
 * also null if the bridge has left out many poses.
 */
export function poseAt(poses, stamp) {
  const next = poses.findIndex((each) => each.stamp >= stamp - SAME);
  const after = poses[next];
  if (next < 0 || (next === 0 && after.stamp > stamp + SAME)) return null;
  const before = poses[next - 1] ?? after;
  const span = after.stamp - before.stamp;
  const part = span ? Math.min(1, (stamp - before.stamp) / span) : 1;
  const [dx, dy, turn] = after.pose.map((value, i) => value - before.pose[i]);
  const isBetween = stamp < after.stamp - SAME;
  if (isBetween && (span > GAP || Math.hypot(dx, dy) > PLACED)) return null;
  const whole = Math.atan2(Math.sin(turn), Math.cos(turn));
  const [x, y, theta] = before.pose;
  // On the chord: in this time, the arc is a few millimetres beside it.
  return [x + part * dx, y + part * dy, theta + part * whole];
}
/** The points [x, y] that a scan (sensor_msgs/LaserScan) from a pose of the car has hit. */
export function points({ ranges, angle_min: begin, angle_increment }, pose) {
  const [x, y, theta] = pose;
  const from = [x + LASER * Math.cos(theta), y + LASER * Math.sin(theta)];
  const hits = ranges.map((range, i) => {
    const angle = theta + begin + i * angle_increment;
    return (
      range && [
        from[0] + range * Math.cos(angle),
        from[1] + range * Math.sin(angle),
      ]
    );
  });
  return hits.filter(Boolean);
}
