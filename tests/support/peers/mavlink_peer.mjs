// node-mavlink as peer: judges frames of ours, and signs, forges and alters frames for us.
//   node mavlink_peer.mjs verify KEYHEX < frames        one JSON line a frame
//   node mavlink_peer.mjs genuine KEYHEX COUNT          signed frames, as kind byte, length, frame
//   node mavlink_peer.mjs attack KEYHEX COUNT           frames that nobody may accept, likewise
import { createHash } from 'node:crypto'
import {
  MavLinkPacketParser, MavLinkPacketSignature, MavLinkPacketSplitter, MavLinkProtocolV2, common, minimal, x25crc,
} from 'node-mavlink'

const [verb, keyHex, count] = process.argv.slice(2)
const key = Buffer.from(keyHex, 'hex')
const REGISTRY = { ...minimal.REGISTRY, ...common.REGISTRY }
const LOCAL_POSITION_MAGIC = 185
const SIGNATURE = MavLinkPacketSignature.SIGNATURE_LENGTH
const start = Date.now()

function position(index) {
  const message = new common.LocalPositionNed()
  Object.assign(message, { timeBootMs: index, x: index, y: -index, z: 1, vx: 0.5, vy: 0.25, vz: 0.125 })
  return message
}

function unsigned(index) {
  return new MavLinkProtocolV2(1, 1, 0).serialize(position(index), index % 256)
}

function signed(index, secret = key) {
  const protocol = new MavLinkProtocolV2(1, 1, MavLinkProtocolV2.IFLAG_SIGNED)
  // Half an hour ahead: newer than the start of whoever judges these frames.
  return protocol.sign(protocol.serialize(position(index), index % 256), 0, secret, start + 1800000 + index)
}

function withChecksum(frame, trailer) {
  frame.writeUInt16LE(x25crc(frame, 1, trailer + 2, LOCAL_POSITION_MAGIC), frame.length - trailer - 2)
  return frame
}

const ATTACKS = [
  unsigned,
  (index) => signed(index, createHash('sha256').update('another key').digest()),
  () => signed(0), // recorded
  (index) => { // a payload bit, with a checksum that fits again
    const frame = signed(index)
    frame[10 + index % 24] ^= 1 << index % 8
    return withChecksum(frame, SIGNATURE)
  },
  (index) => { // a timestamp of the future
    const frame = signed(index)
    frame.writeUIntLE(frame.readUIntLE(frame.length - 12, 6) + 100000000, frame.length - 12, 6)
    return frame
  },
  (index) => { // another link, to look like a new stream
    const frame = signed(index)
    frame[frame.length - SIGNATURE] = 1 + index % 255
    return frame
  },
  (index) => { // one bit of the signature itself
    const frame = signed(index)
    frame[frame.length - 1 - index % 6] ^= 1 << index % 8
    return frame
  },
  (index) => { // the signature cut off
    const frame = Buffer.from(signed(index).subarray(0, -SIGNATURE))
    frame[2] = 0
    return withChecksum(frame, 0)
  },
]

function emit(kind, frame) {
  process.stdout.write(Buffer.concat([Buffer.from([kind, frame.length % 256, frame.length >> 8]), frame]))
}

function describe(packet) {
  const clazz = REGISTRY[packet.header.msgid]
  const fields = clazz ? packet.protocol.data(packet.payload, clazz) : {}
  console.log(JSON.stringify({
    id: packet.header.msgid, system: packet.header.sysid, component: packet.header.compid, seq: packet.header.seq,
    signed: packet.signature !== null, matches: packet.signature?.matches(key) ?? false,
    tick: packet.signature ? packet.buffer.readUIntLE(packet.buffer.length - 12, 6) : null, fields,
  }, (_, value) => typeof value === 'bigint' ? Number(value) : value))
}

if (verb === 'verify') {
  process.stdin.pipe(new MavLinkPacketSplitter()).pipe(new MavLinkPacketParser()).on('data', describe)
} else {
  const kinds = verb === 'genuine' ? [signed] : ATTACKS
  for (let index = 1; index <= Number(count); index++) {
    const kind = index % kinds.length
    emit(kind, Buffer.from(kinds[kind](index)))
  }
}
