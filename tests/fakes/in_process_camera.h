// Aravis' camera without a transport: a device of its own kind inside this process, `Fake_1`, that
// can be opened while an object of this class exists. Not GigE Vision: no packets, no control to
// lose, names of features as before SFNC 2, and pixels that are the library's.
#pragma once

namespace etalon {

class InProcessCamera {
public:
    InProcessCamera();
    ~InProcessCamera();
    InProcessCamera(const InProcessCamera&) = delete;
    InProcessCamera& operator=(const InProcessCamera&) = delete;

    static constexpr const char* uri = "genicam:Fake_1";
};

}  // namespace etalon
