#include "capture/genicam/genicam_chunks.h"

#include <arv.h>
#include <fmt/format.h>

#include <cmath>
#include <cstdlib>

namespace etalon {
namespace {

constexpr std::size_t tag_bytes = 8;     // id and length
constexpr std::size_t max_chunks = 256;  // devices have about twenty

std::uint32_t number(std::span<const std::uint8_t> bytes, std::endian order) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i)
        value = value << 8 | bytes[order == std::endian::big ? i : 3 - i];
    return value;
}

constexpr const char* time_feature = "ChunkTimestamp";

constexpr int max_links = 8;              // from a feature to its register
constexpr std::uint64_t max_bytes = 256;  // of a value's chunk

// ---- where a value comes from ----------------------------------------------------------------

using Sources = std::vector<ChunkField::Source>;

struct Property {
    ArvGcPropertyNode* node;
    ArvGcPropertyNodeType type;
};

std::vector<Property> properties(ArvGcNode* node) {
    std::vector<Property> found;
    for (ArvDomNode* child = arv_dom_node_get_first_child(ARV_DOM_NODE(node)); child;
         child = arv_dom_node_get_next_sibling(child))
        if (ARV_IS_GC_PROPERTY_NODE(child)) {
            ArvGcPropertyNode* property = ARV_GC_PROPERTY_NODE(child);
            found.push_back({property, arv_gc_property_node_get_node_type(property)});
        }
    return found;
}

// The id of the chunk that a port reads; nothing for the device's own.
std::optional<std::uint32_t> chunk_id(ArvGcNode* port) {
    if (!port || !ARV_IS_GC_PORT(port))
        return std::nullopt;
    for (const Property& property : properties(port)) {
        if (property.type != ARV_GC_PROPERTY_NODE_TYPE_CHUNK_ID)
            continue;
        ErrorSlot unreadable;
        const char* text = arv_gc_property_node_get_string(property.node, unreadable.out());
        if (text && !unreadable)
            return static_cast<std::uint32_t>(std::strtoul(text, nullptr, 16));
    }
    return std::nullopt;
}

bool depends_on_the_device(ArvGcPropertyNodeType type) {
    return type == ARV_GC_PROPERTY_NODE_TYPE_P_ADDRESS ||
           type == ARV_GC_PROPERTY_NODE_TYPE_P_INDEX || type == ARV_GC_PROPERTY_NODE_TYPE_P_LENGTH;
}

std::optional<ChunkField::Source> register_source(ArvGcNode* node) {
    std::optional<std::uint32_t> id;
    for (const Property& property : properties(node)) {
        if (depends_on_the_device(property.type))
            return std::nullopt;
        if (property.type == ARV_GC_PROPERTY_NODE_TYPE_P_PORT)
            id = chunk_id(arv_gc_property_node_get_linked_node(property.node));
    }
    ErrorSlot no_address, no_length;
    const guint64 address = arv_gc_register_get_address(ARV_GC_REGISTER(node), no_address.out());
    const guint64 length = arv_gc_register_get_length(ARV_GC_REGISTER(node), no_length.out());
    if (!id || no_address || no_length || address > max_bytes || length > max_bytes)
        return std::nullopt;
    return ChunkField::Source{*id, static_cast<std::size_t>(address + length)};
}

// Collects the registers of a node's value. False where one is no chunk's or depends on the device.
bool collect_sources(ArvGcNode* node, int links_left, Sources& sources) {
    if (!node || links_left == 0)
        return false;
    if (ARV_IS_GC_REGISTER(node)) {
        const auto source = register_source(node);
        if (source)
            sources.push_back(*source);
        return source.has_value();
    }
    for (const Property& property : properties(node)) {
        if (property.type == ARV_GC_PROPERTY_NODE_TYPE_P_INDEX)
            return false;
        if ((property.type == ARV_GC_PROPERTY_NODE_TYPE_P_VALUE ||
             property.type == ARV_GC_PROPERTY_NODE_TYPE_P_VARIABLE) &&
            !collect_sources(arv_gc_property_node_get_linked_node(property.node), links_left - 1,
                             sources))
            return false;
    }
    return true;
}

// What a stamp counts, where the description does not say nanoseconds: the device's ticks.
std::uint64_t ticks_a_second(const GenicamDevice& device, ArvGcNode* node) {
    const char* unit = ARV_IS_GC_INTEGER(node) ? arv_gc_integer_get_unit(ARV_GC_INTEGER(node)) : "";
    if (unit && std::string(unit) == "ns")
        return 0;
    return genicam_tick_frequency(device);
}

// Nothing for a value that cannot be had from chunks alone.
std::optional<ChunkField> chunk_field(const GenicamDevice& device, const std::string& feature) {
    ArvGcNode* node =
        arv_device_get_feature(arv_camera_get_device(device.camera()), feature.c_str());
    ChunkField field{feature, {}};
    if (!node || (!ARV_IS_GC_INTEGER(node) && !ARV_IS_GC_FLOAT(node)) ||
        !collect_sources(node, max_links, field.sources) || field.sources.empty())
        return std::nullopt;
    field.whole = ARV_IS_GC_INTEGER(node);
    if (feature == time_feature)
        field.ticks_a_second = ticks_a_second(device, node);
    return field;
}

// ---- on and off ------------------------------------------------------------------------------

// Whether it is as wanted now.
bool set_chunk_mode(const GenicamDevice& device, bool on) {
    return device.says_yes([&](GError** e) {
        arv_camera_set_chunk_mode(device.camera(), on, e);
        return !*e && (arv_camera_get_chunk_mode(device.camera(), e) != FALSE) == on;
    });
}

bool enable_chunk(const GenicamDevice& device, const char* chunk) {
    return device.says_yes([&](GError** e) {
        arv_camera_set_chunk_state(device.camera(), chunk, TRUE, e);
        return !*e && arv_camera_get_chunk_state(device.camera(), chunk, e);
    });
}

std::vector<ChunkField> enable_useful_chunks(const GenicamDevice& device) {
    std::vector<ChunkField> fields;
    for (const char* chunk : {"ExposureTime", "Gain", "Timestamp", "FrameID"}) {
        // Older devices have a gain without a unit.
        if (std::string(chunk) == "Gain" && !device.has("Gain"))
            continue;
        const auto field = chunk_field(device, std::string("Chunk") + chunk);
        if (field && enable_chunk(device, chunk))
            fields.push_back(*field);
    }
    return fields;
}

// ---- values ----------------------------------------------------------------------------------

std::string layout_fault(const ChunkField& field, const PayloadParts& parts) {
    for (const ChunkField::Source& source : field.sources) {
        const Chunk* chunk = parts.find(source.id);
        if (!chunk)
            return fmt::format("{}: the chunk {:#x} is missing", field.feature, source.id);
        if (chunk->data.size() < source.bytes)
            return fmt::format("{}: the chunk {:#x} has {} bytes, {} are needed", field.feature,
                               source.id, chunk->data.size(), source.bytes);
    }
    return "";
}

std::string read_field(const ChunkField& field, ArvChunkParser* parser, ArvBuffer* buffer,
                       ChunkValues& values) {
    ErrorSlot error;
    const char* name = field.feature.c_str();
    std::uint64_t whole = 0;
    double number = 0.0;
    if (field.whole) {
        whole = static_cast<std::uint64_t>(
            arv_chunk_parser_get_integer_value(parser, buffer, name, error.out()));
        number = static_cast<double>(whole);
    } else {
        number = arv_chunk_parser_get_float_value(parser, buffer, name, error.out());
    }
    if (error)
        return field.feature + ": " + error.message();
    if (field.feature == "ChunkExposureTime")
        values.exposure_us = number;
    else if (field.feature == "ChunkGain")
        values.gain_db = number;
    else if (field.whole && field.feature == time_feature)
        values.time_ns = nanoseconds_of_ticks(whole, field.ticks_a_second);
    else if (field.whole)
        values.frame_id = whole;
    return "";
}

}  // namespace

const Chunk* PayloadParts::find(std::uint32_t id) const {
    const auto found = std::find_if(chunks.begin(), chunks.end(),
                                    [&](const Chunk& each) { return each.id == id; });
    return found == chunks.end() ? nullptr : &*found;
}

std::string split_payload(std::span<const std::uint8_t> payload, std::size_t image_bytes,
                          std::endian order, PayloadParts& parts) {
    parts = {};
    std::size_t end = payload.size();
    while (end != 0 && end != image_bytes) {
        if (end < tag_bytes)
            return fmt::format("{} bytes are left over before its chunks", end);
        if (parts.chunks.size() == max_chunks)
            return fmt::format("it has more than {} chunks", max_chunks);
        const std::size_t before = end - tag_bytes;
        const std::uint32_t id = number(payload.subspan(before, 4), order);
        const std::size_t length = number(payload.subspan(before + 4, 4), order);
        if (length > before)
            return fmt::format("its chunk {:#x} has a length of {} bytes, {} are there", id, length,
                               before);
        end = before - length;
        parts.chunks.push_back({id, payload.subspan(end, length)});
    }
    parts.image = payload.first(end);
    if (end == 0 && !parts.chunks.empty()) {
        parts.image = parts.chunks.back().data;
        parts.chunks.pop_back();
    }
    return "";
}

GenicamChunks switch_chunks_on(const GenicamDevice& device) {
    GenicamChunks chunks;
    if (!device.has("ChunkModeActive"))
        return chunks;
    if (device.has("ChunkSelector") && set_chunk_mode(device, true))
        chunks.fields = enable_useful_chunks(device);
    if (chunks.fields.empty())
        set_chunk_mode(device, false);
    else
        chunks.parser.reset(arv_camera_create_chunk_parser(device.camera()), UnrefObject());
    return chunks;
}

bool chunks_are_on(const GenicamDevice& device) {
    return device.has("ChunkModeActive") && device.says_yes([&](GError** e) {
        return arv_camera_get_chunk_mode(device.camera(), e);
    });
}

bool chunks_are_readable(ArvBuffer* buffer) {
    return arv_buffer_has_chunks(buffer);
}

std::string read_chunks(const GenicamChunks& chunks, ArvBuffer* buffer, const PayloadParts& parts,
                        ChunkValues& values) {
    for (const ChunkField& field : chunks.fields) {
        std::string fault = layout_fault(field, parts);
        if (fault.empty())
            fault = read_field(field, chunks.parser.get(), buffer, values);
        if (!fault.empty())
            return fault;
    }
    return "";
}

std::string contradiction(const ChunkValues& values, const CaptureSettings& settings,
                          double exposure_step_us) {
    const auto exposure_us = static_cast<double>(settings.exposure.count());
    const double tolerance_us = std::max({exposure_step_us, 1.0, 1e-3 * exposure_us});
    if (values.exposure_us && !(std::abs(*values.exposure_us - exposure_us) <= tolerance_us))
        return fmt::format("it was taken with an exposure of {:.7g} us, not {:.7g} us",
                           *values.exposure_us, exposure_us);
    if (values.gain_db && !(std::abs(*values.gain_db - settings.gain_db) <= 0.05))
        return fmt::format("it was taken with a gain of {:.4g} dB, not {:.4g} dB", *values.gain_db,
                           settings.gain_db);
    return "";
}

}  // namespace etalon
