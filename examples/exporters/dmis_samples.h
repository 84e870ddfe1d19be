// Writes the table of `python -m dmis doctor` (docs/doctor.md): dmis_samples::Table t; t.add(...); t.write("t.npz").
// One header, C++11, no dependency. Not safe for threads: one table per thread, or a lock around add.
#pragma once
#include <cstdint>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace dmis_samples {

struct Row {
  int32_t pixel, camera_sample;  // row * width + column; counted from 0 in each pixel
  int8_t technique;              // 0 light sampling, 1 BRDF sampling
  float f[3];                    // BRDF * radiance * cosine * visibility, 0 if occluded: write the row all the same
  float p_l, p_b;                // densities of both techniques in this direction, per solid angle
  int16_t light, lobe;           // any numbers of the light, and of the material at the surface, whatever lobe drew
  float direction[3], normal[3], geometric_normal[3], light_normal[3], distance;  // to the light; infinite: a sky
};

class Table {
 public:
  Table(int light_samples, int brdf_samples) : counts{1, light_samples, brdf_samples} {}  // of each camera sample
  void add(const Row& row) { rows.push_back(row); }

  void write(const std::string& path) {
    out.open(path, std::ios::binary);
    const char* names[] = {"version", "light_samples", "brdf_samples"};
    for (int k = 0; k < 3; k++) entry(names[k], "<i4", "", std::string((const char*)&counts[k], 4));
    int32_t n = (int32_t)rows.size();
    entry("rows", "<i4", "", std::string((const char*)&n, 4));
    column("pixel", "<i4", 1, &Row::pixel), column("camera_sample", "<i4", 1, &Row::camera_sample);
    column("technique", "|i1", 1, &Row::technique), column("f", "<f4", 3, &Row::f);
    column("p_l", "<f4", 1, &Row::p_l), column("p_b", "<f4", 1, &Row::p_b);
    column("light", "<i2", 1, &Row::light), column("lobe", "<i2", 1, &Row::lobe);
    column("direction", "<f4", 3, &Row::direction), column("normal", "<f4", 3, &Row::normal);
    column("geometric_normal", "<f4", 3, &Row::geometric_normal), column("distance", "<f4", 1, &Row::distance);
    column("light_normal", "<f4", 3, &Row::light_normal);
    uint32_t begin = (uint32_t)out.tellp();
    out << central;  // the zip's directory, and its end
    out << std::string("PK\5\6\0\0\0\0", 8) << u16(files) << u16(files) << u32(central.size()) << u32(begin) << u16(0);
    out.close();
    if (!out) throw std::runtime_error("cannot write " + path);
  }

 private:
  int32_t counts[3];
  std::vector<Row> rows;
  std::ofstream out;
  std::string central;
  uint32_t files = 0;
  static std::string u16(uint32_t x) { return {char(x), char(x >> 8)}; }
  static std::string u32(uint64_t x) { return u16(uint32_t(x)) + u16(uint32_t(x >> 16)); }

  template <class T>
  void column(const char* name, const char* type, int width, T Row::*member) {
    std::string data;
    for (const Row& row : rows) data.append((const char*)&(row.*member), sizeof(T));
    entry(name, type, std::to_string(rows.size()) + (width == 3 ? ", 3" : ","), data);
  }

  void entry(const std::string& name, const char* type, const std::string& shape, const std::string& data) {
    std::string text = std::string("{'descr': '") + type + "', 'fortran_order': False, 'shape': (" + shape + ")}";
    text.append(63 - (text.size() + 10) % 64, ' ').append("\n");
    std::string file = std::string("\x93NUMPY\1\0", 8) + u16(uint32_t(text.size())) + text + data;
    if (file.size() + (uint64_t)out.tellp() >= 0xffffffffu) throw std::runtime_error("the table is above 4 GB");
    uint32_t crc = ~0u;  // of a zip
    for (unsigned char byte : file) {
      crc ^= byte;
      for (int bit = 0; bit < 8; bit++) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0);
    }
    std::string info = u16(20) + u16(0) + u16(0) + u32(0) + u32(~crc) + u32(file.size()) + u32(file.size());
    info += u16(uint32_t(name.size() + 4)) + u16(0);
    central += "PK\1\2" + u16(20) + info + u16(0) + u16(0) + u16(0) + u32(0) + u32((uint64_t)out.tellp()) + name + ".npy";
    out << "PK\3\4" << info << name << ".npy" << file;
    files++;
  }
};

}  // namespace dmis_samples
