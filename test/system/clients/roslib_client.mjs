// Use the bridge with roslib 1 or 2, and print what came as JSON:
// roslib_client.mjs FILE URL X Y, the module of roslib, and a start pose.

const [file, url, ...start] = process.argv.slice(2);
const { default: roslib1, ...roslib2 } = await import(file);
const ROSLIB = roslib1 ?? roslib2;
const [x, y] = start.map(Number);

const ros = new ROSLIB.Ros({});
const errors = [];
const emit = ros.emit;
// An error is an event with the id of the request in its name, and roslib makes these ids itself.
ros.emit = function (name, ...values) {
  if (String(name).startsWith("status")) errors.push(values[0].msg);
  return emit.call(this, name, ...values);
};

const connected = new Promise((resolve, reject) => {
  ros.on("connection", resolve);
  ros.on("error", reject);
});
ros.connect(url);
await connected;

const topic = (name, messageType) =>
  new ROSLIB.Topic({ ros, name, messageType });
const received = (name, type, condition = () => true) =>
  new Promise((resolve) => {
    const source = topic(name, type);
    source.subscribe((msg) => {
      if (!condition(msg)) return;
      source.unsubscribe();
      resolve(msg);
    });
  });
const called = (name) =>
  new Promise((resolve, reject) =>
    new ROSLIB.Service({
      ros,
      name,
      serviceType: "std_srvs/Trigger",
    }).callService({}, resolve, reject),
  );

const isOfCar = (each) => each.child_frame_id === "car/base_footprint";
const found = {};
const [pose, map, scan, tf, topics] = await Promise.all([
  received("/car/car_pose", "geometry_msgs/PoseStamped"),
  received("/map", "nav_msgs/OccupancyGrid"),
  received("/car/scan", "sensor_msgs/LaserScan"),
  received("/tf", "tf2_msgs/TFMessage", ({ transforms }) =>
    transforms.some(isOfCar),
  ),
  new Promise((resolve, reject) => ros.getTopics(resolve, reject)),
]);
found.pose = pose.header.frame_id;
found.map = [map.info.width, map.info.height, map.data.length];
found.scan = scan.ranges.length;
found.tf = tf.transforms.find(isOfCar).header.frame_id;
found.topics = topics.topics.includes("/car/car_pose");

const path = "/click_planner/path";
const isStart = ({ position }) => position.x === x && position.y === y;
const begun = [
  received("/car/car_pose", "geometry_msgs/PoseStamped", (msg) =>
    isStart(msg.pose),
  ),
  received(
    path,
    "nav_msgs/Path",
    ({ poses }) => poses.length > 0 && isStart(poses[0].pose),
  ),
];
topic("/initialpose", "geometry_msgs/PoseWithCovarianceStamped").publish({
  header: { frame_id: "map" },
  pose: {
    pose: { position: { x, y, z: 0 }, orientation: { x: 0, y: 0, z: 0, w: 1 } },
  },
});
found.placed = (await Promise.all(begun))[0].pose.position;
const drawn = received(
  path,
  "nav_msgs/Path",
  ({ poses }) => poses.length > 1 && isStart(poses[0].pose),
);
topic("/clicked_point", "geometry_msgs/PointStamped").publish({
  header: { frame_id: "map" },
  point: { x: x + 1, y, z: 0 },
});
found.clicked = (await drawn).poses.at(-1).pose.position.x;
const nodes = await new Promise((resolve, reject) =>
  ros.getNodes(resolve, reject),
);
found.nodes = await Promise.all(
  nodes.map(
    (node) =>
      new Promise((resolve, reject) =>
        ros.getNodeDetails(node, () => resolve(node), reject),
      ),
  ),
);
found.param = await new Promise((resolve) =>
  new ROSLIB.Param({ ros, name: "/car/car_sim/pose_rate" }).get(resolve),
);
found.undo = await called("/click_planner/undo");
found.undoAgain = await called("/click_planner/undo");
found.service = await called("/car/car_sim/explode").catch((error) =>
  String(error),
);

topic("/car/car_pose", "geometry_msgs/PoseStamped").publish(pose);
topic("/clicked_point", "geometry_msgs/PointStamped").publish({
  place: [1, 2],
});
topic("/car/scan", "std_msgs/String").subscribe(() => {});
while (errors.length < 4)
  await new Promise((resolve) => setTimeout(resolve, 10));
found.errors = errors;
console.log(JSON.stringify(found));
process.exit();
