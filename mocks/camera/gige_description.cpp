#include "mocks/camera/gige_description.h"

#include <fmt/format.h>

#include "capture/frame/pixel_formats.h"

namespace etalon {
namespace {

constexpr const char* head = R"(<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName="Fake" VendorName="Aravis" StandardNameSpace="GEV"
    SchemaMajorVersion="1" SchemaMinorVersion="0" SchemaSubMinorVersion="1"
    MajorVersion="1" MinorVersion="0" SubMinorVersion="0" ToolTip="Mock" ProductGuid="0"
    VersionGuid="0" xmlns="http://www.genicam.org/GenApi/Version_1_0">
<Port Name="Device"/>
)";

std::string category(const char* name, const std::vector<std::string>& features) {
    std::string text = fmt::format("<Category Name=\"{}\">", name);
    for (const std::string& feature : features)
        text += fmt::format("<pFeature>{}</pFeature>", feature);
    return text + "</Category>\n";
}

std::string text_register(const char* name, int address, int length) {
    return fmt::format(
        "<StringReg Name=\"{}\"><Address>{:#x}</Address><Length>{}</Length>"
        "<AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>\n",
        name, address, length);
}

std::string register_node(const std::string& name, std::uint32_t address, int length = 4,
                          const char* sign = "Unsigned", const char* index = "") {
    return fmt::format(
        "<IntReg Name=\"{}\"><Address>{:#x}</Address>{}<Length>{}</Length>"
        "<AccessMode>RW</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable>"
        "<Sign>{}</Sign><Endianess>BigEndian</Endianess></IntReg>\n",
        name, address, index, length, sign);
}

// An integer feature over a register of its own; `limits` are its Min, Max and Inc elements.
std::string integer(const std::string& name, std::uint32_t address, const std::string& limits) {
    return fmt::format("<Integer Name=\"{0}\"><pValue>{0}Register</pValue>{1}</Integer>\n", name,
                       limits) +
           register_node(name + "Register", address);
}

std::string limits(double low, double high) {
    return fmt::format("<Min>{}</Min><Max>{}</Max>", low, high);
}

// A float feature over a register of whole numbers.
std::string whole_float(const std::string& name, std::uint32_t address, double low, double high,
                        const char* unit) {
    return fmt::format(
               "<Float Name=\"{0}\"><pValue>{0}Converter</pValue>{1}<Unit>{2}</Unit></Float>\n"
               "<Converter Name=\"{0}Converter\"><FormulaTo>FROM</FormulaTo>"
               "<FormulaFrom>TO</FormulaFrom><pValue>{0}Register</pValue></Converter>\n",
               name, limits(low, high), unit) +
           register_node(name + "Register", address);
}

struct Choice {
    std::string name;
    std::uint32_t value;
};

std::string enumeration(const std::string& name, std::uint32_t address,
                        const std::vector<Choice>& choices) {
    std::string text = fmt::format("<Enumeration Name=\"{}\">", name);
    for (const Choice& choice : choices)
        text += fmt::format("<EnumEntry Name=\"{}\"><Value>{}</Value></EnumEntry>", choice.name,
                            choice.value);
    return text + fmt::format("<pValue>{}Register</pValue></Enumeration>\n", name) +
           register_node(name + "Register", address);
}

std::string command(const std::string& name, const std::string& register_name, int value) {
    return fmt::format(
        "<Command Name=\"{}\"><pValue>{}</pValue><CommandValue>{}</CommandValue></Command>\n", name,
        register_name, value);
}

std::string device_features() {
    return category("DeviceControl",
                    {"DeviceVendorName", "DeviceModelName", "DeviceVersion", "DeviceID"}) +
           text_register("DeviceVendorName", 0x48, 32) +
           text_register("DeviceModelName", 0x68, 32) + text_register("DeviceVersion", 0x88, 32) +
           text_register("DeviceID", 0xd8, 16);
}

std::string image_features(const std::vector<std::string>& formats) {
    std::vector<Choice> choices;
    for (const std::string& format : formats)
        choices.push_back({format, find_pfnc_format(format)->pfnc_code});
    return category("ImageFormatControl", {"SensorWidth", "SensorHeight", "OffsetX", "OffsetY",
                                           "Width", "Height", "PixelFormat"}) +
           integer("SensorWidth", 0x11c, "") + integer("SensorHeight", 0x118, "") +
           integer("OffsetX", 0x130, "<Min>0</Min><pMax>SensorWidth</pMax>") +
           integer("OffsetY", 0x134, "<Min>0</Min><pMax>SensorHeight</pMax>") +
           integer("Width", 0x100, "<Min>1</Min><pMax>SensorWidth</pMax><Inc>1</Inc>") +
           integer("Height", 0x104, "<Min>1</Min><pMax>SensorHeight</pMax><Inc>1</Inc>") +
           enumeration("PixelFormat", 0x128, choices);
}

std::string frame_rate() {
    return "<Float Name=\"AcquisitionFrameRate\"><pValue>FrameRateConverter</pValue>"
           "<Unit>Hz</Unit></Float>\n"
           "<Converter Name=\"FrameRateConverter\"><FormulaTo>(1000000 / FROM)</FormulaTo>"
           "<FormulaFrom>(1000000 / TO)</FormulaFrom><pValue>FramePeriod</pValue></Converter>\n" +
           integer("FramePeriod", 0x138, limits(1000, 10000000));
}

std::string acquisition_features() {
    return category("AcquisitionControl",
                    {"AcquisitionMode", "AcquisitionStart", "AcquisitionStop", "TriggerSelector",
                     "TriggerMode", "TriggerSource", "TriggerActivation", "TriggerSoftware",
                     "ExposureTime", "AcquisitionFrameRate"}) +
           enumeration("AcquisitionMode", 0x12c, {{"Continuous", 1}, {"SingleFrame", 2}}) +
           register_node("AcquisitionRegister", 0x124) +
           command("AcquisitionStart", "AcquisitionRegister", 1) +
           command("AcquisitionStop", "AcquisitionRegister", 0) +
           "<Enumeration Name=\"TriggerSelector\"><EnumEntry Name=\"FrameStart\"><Value>0</Value>"
           "</EnumEntry><Value>0</Value></Enumeration>\n" +
           enumeration("TriggerMode", 0x300, {{"Off", 0}, {"On", 1}}) +
           enumeration("TriggerSource", trigger_source_register, {{"Software", 0}, {"Line1", 7}}) +
           enumeration("TriggerActivation", 0x308, {{"RisingEdge", 0}}) +
           register_node("TriggerSoftwareRegister", 0x30c) +
           command("TriggerSoftware", "TriggerSoftwareRegister", 1) +
           whole_float("ExposureTime", 0x120, 10, 10000000, "us") + frame_rate();
}

std::string analog_features() {
    return category("AnalogControl", {"Gain", "GainAuto", "BlackLevel"}) +
           whole_float("Gain", 0x110, 0, 10, "dB") +
           enumeration("GainAuto", 0x114, {{"Off", 1}, {"Continuous", 2}}) +
           whole_float("BlackLevel", black_level_register, 0, 255, "DN");
}

std::string boolean(const std::string& name, std::uint32_t address) {
    return fmt::format(
               "<Boolean Name=\"{0}\"><pValue>{0}Register</pValue><OnValue>1</OnValue>"
               "<OffValue>0</OffValue></Boolean>\n",
               name) +
           register_node(name + "Register", address);
}

// The image, and with chunks their bytes and the 8 that follow each.
std::string payload_size(bool chunks) {
    std::string variables, extra;
    if (chunks) {
        variables = "<pVariable Name=\"C\">ChunkModeActiveRegister</pVariable>";
        extra = " + C * (8";
        for (const MockChunk& chunk : mock_chunks) {
            variables += fmt::format("<pVariable Name=\"E{0}\">{1}EnabledRegister</pVariable>",
                                     chunk.selected, chunk.name);
            extra += fmt::format(" + E{} * {}", chunk.selected, chunk.bytes + 8);
        }
        extra += ")";
    }
    return "<IntSwissKnife Name=\"PayloadSize\"><pVariable Name=\"W\">Width</pVariable>"
           "<pVariable Name=\"H\">Height</pVariable>"
           "<pVariable Name=\"F\">PixelFormat</pVariable>" +
           variables + "<Formula>W * H * ((F &gt;&gt; 16) &amp; 0xFF) / 8" + extra +
           "</Formula></IntSwissKnife>\n";
}

std::string clock_features() {
    return register_node("TimestampLatchRegister", latch_register) +
           command("TimestampLatch", "TimestampLatchRegister", 1) +
           "<Integer Name=\"TimestampLatchValue\"><pValue>LatchedTimeRegister</pValue>"
           "<Unit>ns</Unit></Integer>\n" +
           register_node("LatchedTimeRegister", latched_time_register, 8);
}

std::string ptp_feature_nodes() {
    std::vector<Choice> states;
    for (const PtpStatusCode& code : ptp_status_codes)
        states.push_back({code.name, code.value});
    return boolean("PtpEnable", ptp_enable_register) +
           register_node("PtpDataSetLatchRegister", ptp_latch_register) +
           command("PtpDataSetLatch", "PtpDataSetLatchRegister", 1) +
           enumeration("PtpStatus", ptp_status_register, states) +
           "<Integer Name=\"PtpOffsetFromMaster\"><pValue>PtpOffsetRegister</pValue>"
           "<Unit>ns</Unit></Integer>\n" +
           register_node("PtpOffsetRegister", ptp_offset_register, 8, "Signed");
}

std::string transport_features(const GigeFeatures& features) {
    std::string text =
        category("TransportLayerControl", {"PayloadSize"}) + payload_size(features.chunks) +
        "<Integer Name=\"TLParamsLocked\"><Value>0</Value>" + limits(0, 1) + "</Integer>\n";
    if (features.latches)
        text += clock_features();
    if (features.ptp)
        text += ptp_feature_nodes();
    return text;
}

// `type` is IntReg or FloatReg.
std::string chunk_register(const MockChunk& chunk, const char* type, const char* order) {
    return fmt::format(
        "<Port Name=\"{0}ChunkPort\"><ChunkID>{1:x}</ChunkID></Port>\n"
        "<{2} Name=\"{0}ChunkRegister\"><Address>0</Address><Length>{3}</Length>"
        "<AccessMode>RO</AccessMode><pPort>{0}ChunkPort</pPort>"
        "<Cachable>NoCache</Cachable>{4}<Endianess>{5}</Endianess></{2}>\n",
        chunk.name, chunk.id, type, chunk.bytes,
        std::string_view(type) == "IntReg" ? "<Sign>Unsigned</Sign>" : "", order);
}

std::string chunk_values() {
    return chunk_register(exposure_chunk, "FloatReg", "LittleEndian") +
           "<Float Name=\"ChunkExposureTime\"><pValue>ExposureTimeChunkRegister</pValue>"
           "<Unit>us</Unit></Float>\n" +
           chunk_register(gain_chunk, "IntReg", "LittleEndian") +
           "<Float Name=\"ChunkGain\"><pValue>ChunkGainConverter</pValue></Float>\n"
           "<Converter Name=\"ChunkGainConverter\"><FormulaTo>FROM * 10</FormulaTo>"
           "<FormulaFrom>TO * 0.1</FormulaFrom><pValue>GainChunkRegister</pValue></Converter>\n" +
           chunk_register(timestamp_chunk, "IntReg", "BigEndian") +
           "<Integer Name=\"ChunkTimestamp\"><pValue>TimestampChunkRegister</pValue>"
           "<Unit>ns</Unit></Integer>\n" +
           chunk_register(frame_id_chunk, "IntReg", "BigEndian") +
           "<Integer Name=\"ChunkFrameID\"><pValue>FrameIDChunkRegister</pValue></Integer>\n";
}

std::string chunk_features() {
    std::vector<Choice> choices{{"Image", 0}};
    std::string enabled;
    for (const MockChunk& chunk : mock_chunks) {
        choices.push_back({chunk.name, chunk.selected});
        enabled += register_node(fmt::format("{}EnabledRegister", chunk.name),
                                 chunk_enable_registers + 4 * chunk.selected);
    }
    return category("ChunkDataControl",
                    {"ChunkModeActive", "ChunkSelector", "ChunkEnable", "ChunkExposureTime",
                     "ChunkGain", "ChunkTimestamp", "ChunkFrameID"}) +
           boolean("ChunkModeActive", chunk_mode_register) +
           enumeration("ChunkSelector", chunk_selector_register, choices) +
           "<Boolean Name=\"ChunkEnable\"><pValue>ChunkEnableRegister</pValue><OnValue>1</OnValue>"
           "<OffValue>0</OffValue></Boolean>\n" +
           register_node("ChunkEnableRegister", chunk_enable_registers, 4, "Unsigned",
                         "<pIndex Offset=\"4\">ChunkSelectorRegister</pIndex>") +
           enabled + chunk_values();
}

}  // namespace

std::string gige_description(const GigeFeatures& features) {
    std::vector<std::string> categories{"DeviceControl", "ImageFormatControl", "AcquisitionControl",
                                        "AnalogControl", "TransportLayerControl"};
    if (features.chunks)
        categories.emplace_back("ChunkDataControl");
    return head + category("Root", categories) + device_features() +
           image_features(features.formats) + acquisition_features() + analog_features() +
           transport_features(features) + (features.chunks ? chunk_features() : "") +
           "</RegisterDescription>\n";
}

}  // namespace etalon
