/*
 * Cart Pole in JavaScript, physics included: nothing is needed but Node 20 and a Shepherd server.
 *
 *     python manage.py create_agent --owner me --name "Cart Pole" --algorithm PPO --action-space 2 \
 *         --observation-space '[[4], -10, 10]'
 *     SHEPHERD_API_KEY=sk_... node clients/examples/cart_pole.mjs [episodes]
 *
 * SHEPHERD_URL says where Shepherd is, if not at http://127.0.0.1:8000.
 */
import { Client } from "../javascript/shepherd-client.js";

const LONGEST_EPISODE = 500; // steps

/**
 * A pole on a cart, after Barto, Sutton and Anderson, "Neuronlike adaptive elements that can solve difficult learning
 * control problems" (1983), with Euler's method.
 *
 * Actions: 0 pushes the cart left, 1 right. Observation: position in m, velocity in m/s, angle in rad, angular velocity in
 * rad/s. Reward: 1 per step. Start: all four between -0.05 and 0.05. End: past 2.4 m or 12 degrees; truncated after 500.
 */
class CartPole {
  static gravity = 9.8; // m/s^2
  static cartMass = 1.0; // kg
  static poleMass = 0.1; // kg
  static halfLength = 0.5; // m
  static force = 10.0; // N
  static interval = 0.02; // s

  reset() {
    this.steps = 0;
    this.state = Array.from({ length: 4 }, () => 0.1 * Math.random() - 0.05);
    return this.state;
  }

  step(action) {
    const { gravity, cartMass, poleMass, halfLength, force, interval } = CartPole;
    const [x, speed, angle, spin] = this.state;
    const mass = cartMass + poleMass;
    const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
    const push = ((action === 1 ? force : -force) + poleMass * halfLength * spin ** 2 * sin) / mass;
    const angular = (gravity * sin - cos * push) / (halfLength * (4 / 3 - (poleMass * cos ** 2) / mass));
    const linear = push - (poleMass * halfLength * angular * cos) / mass;
    this.state = [x + interval * speed, speed + interval * linear, angle + interval * spin, spin + interval * angular];
    this.steps += 1;
    const terminated = Math.abs(this.state[0]) > 2.4 || Math.abs(this.state[2]) > (12 * Math.PI) / 180;
    return { obs: this.state, reward: 1, terminated, truncated: this.steps >= LONGEST_EPISODE };
  }
}

async function playEpisode(env, session) {
  let obs = env.reset();
  for (;;) {
    const action = await session.act(obs);
    const outcome = env.step(action);
    obs = outcome.obs;
    const total = await session.observe(obs, outcome.reward, outcome);
    if (total !== null) return total;
  }
}

const { SHEPHERD_API_KEY, SHEPHERD_URL } = process.env;
const episodes = Number(process.argv[2] ?? 500);
const session = await new Client(SHEPHERD_API_KEY, { url: SHEPHERD_URL }).session();
try {
  const env = new CartPole();
  for (let episode = 1; episode <= episodes; episode++) {
    console.log(`episode ${episode}: ${await playEpisode(env, session)}`);
  }
} finally {
  await session.close();
}
