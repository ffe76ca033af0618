// Subscribes to all that a server has, with Foxglove's own client, and prints the first message of each channel: node foxglove_client.cjs URL
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const WebSocket = require("ws");

const topics = new Map();
const seen = {};
const client = new FoxgloveClient({ ws: new WebSocket(process.argv[2], [FoxgloveClient.SUPPORTED_SUBPROTOCOL]) });
let hasEnded = false;
const end = (text, code) => {
  if (hasEnded) return;
  hasEnded = true;
  process.stdout.write(text, () => process.exit(code));
};
client.on("error", (error) => end(`error: ${error.message}`, 1));
client.on("advertise", (channels) => {
  for (const channel of channels) {
    JSON.parse(channel.schema);
    topics.set(client.subscribe(channel.id), channel);
  }
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const { topic, schemaName } = topics.get(subscriptionId);
  seen[topic] = { schemaName, timestamp: String(timestamp), message: JSON.parse(new TextDecoder().decode(data)) };
  if (Object.keys(seen).length === topics.size) {
    client.close();
    end(JSON.stringify(seen), 0);
  }
});
setTimeout(() => end(`error: only ${Object.keys(seen)} of ${topics.size} within 60 s`, 1), 60000);
