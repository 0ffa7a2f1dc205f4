// A robot by rosnodejs, whose TCPROS and XML-RPC share nothing with rospy; see stage.py for the words.
'use strict';
const readline = require('readline');
const rosnodejs = require('rosnodejs');
const { Twist } = rosnodejs.require('geometry_msgs').msg;
const { Odometry } = rosnodejs.require('nav_msgs').msg;
const { Bool } = rosnodejs.require('std_msgs').msg;

const config = JSON.parse(process.argv[2]);
const say = (words) => process.stdout.write(JSON.stringify(words) + '\n');
let x = 0.0;
let speed = 0.0;

function hear(twist) {
  speed = twist.linear.x;
  say({ command: [twist.linear.x, twist.linear.y, twist.angular.z], at: process.hrtime()[0], stamp: 0 });
}

async function main() {
  const node = await rosnodejs.initNode('/' + config.node, { onTheFly: false, logging: { skipRosLogging: true } });
  await node.setParam(config.parameter, config.timeout);
  node.subscribe(config.command, Twist, hear, { queueSize: 100, throttleMs: -1 });
  const odometry = node.advertise(config.odometry, Odometry, { queueSize: 1, throttleMs: -1 });
  const stop = node.advertise(config.stop, Bool, { latching: true, throttleMs: -1 });
  stop.publish(new Bool({ data: false }));
  setInterval(() => {
    x += speed * 0.02;
    const message = new Odometry();
    const now = Date.now();
    message.header.stamp = { secs: Math.floor(now / 1000), nsecs: (now % 1000) * 1e6 };
    message.header.frame_id = 'odom';
    message.child_frame_id = 'base_link';
    message.pose.pose.position.x = x;
    message.pose.pose.orientation.w = 1.0;
    message.twist.twist.linear.x = speed;
    odometry.publish(message);
  }, 20);
  readline.createInterface({ input: process.stdin }).on('line', () => process.exit(0));
  say({ ready: true });
}

main();
