// The way to a certificate over the real protocols: a twin with a sensor in its room, a run that
// reads it, and the program `etalon certify`.

#include "tests/loopback/quick_run.h"

namespace etalon {
namespace {

class CertifyCommand : public QuickRun {
protected:
    CertifyCommand() {
        start_twin(
            "room: {port: 0, temperature_c: 20.31, swing_k: 0.12, period_s: 1.7, "
            "humidity_percent: 47.3}\n");
        const std::string room = "room 127.0.0.1:";
        room_port_ = trimmed(twin_ready_.substr(twin_ready_.find(room) + room.size()));
        write_station_with_room(room_port_);
        write_text(folder_ / "certificate.yaml",
                   read_text(ETALON_SOURCE_DIR "/examples/every-key/certificate.yaml"));
    }

    void write_station_with_room(const std::string& port) const {
        const std::string by_hand =
            "environment: {temperature_c: [19.9, 20.5], humidity_percent: [40, 52]}";
        const std::string by_sensor =
            "environment:\n  link: {host: 127.0.0.1, port: " + port +
            ", unit: 9, response_timeout_ms: 200}\n"
            "  temperature: {input_register: 0, type: int16, scale: 0.01}\n"
            "  humidity: {input_register: 1, type: uint16, scale: 0.1}";
        write_text(folder_ / "station.yaml",
                   quick_station(port_) + replaced(traced_text, by_hand, by_sensor));
    }

    std::filesystem::path record() const { return folder_ / "record"; }
    int qualify() const {
        Program program("etalon", {"qualify", (folder_ / "station.yaml").string(), "--out",
                                   record().string(), "--operator", "O. Perator"});
        return program.exit_code();
    }
    std::unique_ptr<Program> certify() const {
        return start_program("etalon", {"certify", record().string(), "--form",
                                        (folder_ / "certificate.yaml").string(), "--out",
                                        (folder_ / "certificate").string()});
    }

    std::string room_port_;
};

// The sine's deviation is 0.12 / sqrt(2) where the poses meet it everywhere.
TEST_F(CertifyCommand, CertifiesARunWhoseRoomWasMeasured) {
    ASSERT_EQ(qualify(), 0);
    EXPECT_EQ(count(record(), "climate"), quick_poses);
    const Json run = run_of(record());
    const Json temperature = run["environment"]["temperature_c"];
    EXPECT_NEAR(temperature["mean"].get<double>(), 20.31, 0.1);
    EXPECT_NEAR(temperature["deviation"].get<double>(), 0.12 / std::sqrt(2.0), 0.04);
    EXPECT_EQ(run["environment"]["humidity_percent"]["mean"], 47.3);
    const auto certifying = certify();
    EXPECT_EQ(certifying->exit_code(), 0);
    const std::string page = read_text(folder_ / "certificate/certificate.html");
    EXPECT_THAT(page, HasSubstr("PASS: the camera conforms"));
    EXPECT_THAT(page, HasSubstr("O. Perator"));
    EXPECT_THAT(page, HasSubstr(" of 24 readings"));
    EXPECT_THAT(read_text(folder_ / "certificate/dcc.xml"), HasSubstr("\\degreecelsius"));
    EXPECT_EQ(run_of(record()), run);  // analysed again: the same figures
}

TEST_F(CertifyCommand, GoesOnWithoutASensorAndThenRefusesToCertify) {
    write_station_with_room("1");  // nobody is there
    EXPECT_EQ(qualify(), 0);
    EXPECT_EQ(count(record(), "climate lost"), 1);
    EXPECT_EQ(count(record(), "pose"), quick_poses);
    const auto refused = certify();
    const std::string said = refused->rest();
    EXPECT_EQ(refused->exit_code(), 3);
    EXPECT_THAT(said, HasSubstr("\nmissing the temperature during the whole run: room sensor"));
    EXPECT_FALSE(std::filesystem::exists(folder_ / "certificate"));
}

}  // namespace
}  // namespace etalon
