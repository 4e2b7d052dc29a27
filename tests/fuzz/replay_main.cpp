// SPDX-License-Identifier: Apache-2.0
// A main() for fuzz targets without libFuzzer: feeds the files of a corpus, and with --seconds goes
// on with changed copies of them. Usage: TARGET [--seconds N] [--seed N] FILE_OR_FOLDER... The
// input at hand is kept as crash-TARGET in the current folder until it was answered.
#include "tests/fuzz/target.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

extern "C" __attribute__((weak)) std::size_t
LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size, unsigned seed);

namespace
{

namespace fs = std::filesystem;
using Bytes = std::vector<std::uint8_t>;

Bytes read(const fs::path& file)
{
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

/// A few random edits: bits, bytes, runs copied, cut out or taken from another input.
Bytes changed(Bytes bytes, const std::vector<Bytes>& corpus, std::mt19937& random)
{
    const auto below = [&](std::size_t n) { return n == 0 ? 0 : random() % n; };
    if (LLVMFuzzerCustomMutator && below(5) != 0) {
        bytes.resize(LLVMFuzzerCustomMutator(bytes.data(), bytes.size(), bytes.size(),
                                             static_cast<unsigned>(random())));
        return bytes;
    }
    for (std::size_t n = 1 + below(4); n > 0; --n) {
        const std::size_t at = below(bytes.size() + 1);
        switch (below(5)) {
        case 0:
            if (at < bytes.size()) bytes[at] ^= static_cast<std::uint8_t>(1u << below(8));
            break;
        case 1:
            if (at < bytes.size()) bytes[at] = static_cast<std::uint8_t>(below(256));
            break;
        case 2: {
            const std::size_t length = std::min(bytes.size() - at, 1 + below(12));
            bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                        bytes.begin() + static_cast<std::ptrdiff_t>(at + length));
            break;
        }
        default: {
            const Bytes& other = corpus[below(corpus.size())];
            const std::size_t from = below(other.size());
            const std::size_t length = std::min(other.size() - from, 1 + below(40));
            bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                         other.begin() + static_cast<std::ptrdiff_t>(from),
                         other.begin() + static_cast<std::ptrdiff_t>(from + length));
        }
        }
    }
    return bytes;
}

} // namespace

int main(int argc, char** argv)
{
    double seconds = 0.0;
    unsigned seed = 1;
    std::vector<Bytes> corpus;
    for (int i = 1; i < argc; ++i) {
        if (std::strcmp(argv[i], "--seconds") == 0 && i + 1 < argc) {
            seconds = std::atof(argv[++i]);
        } else if (std::strcmp(argv[i], "--seed") == 0 && i + 1 < argc) {
            seed = static_cast<unsigned>(std::atoi(argv[++i]));
        } else if (fs::is_directory(argv[i])) {
            std::vector<fs::path> files;
            for (const auto& entry : fs::recursive_directory_iterator(argv[i]))
                if (entry.is_regular_file()) files.push_back(entry.path());
            std::ranges::sort(files);
            for (const fs::path& file : files) corpus.push_back(read(file));
        } else {
            corpus.push_back(read(argv[i]));
        }
    }
    if (corpus.empty()) {
        std::fprintf(stderr, "no input\n");
        return 2;
    }
    for (const Bytes& bytes : corpus) LLVMFuzzerTestOneInput(bytes.data(), bytes.size());

    const std::string kept = "crash-" + fs::path(argv[0]).filename().string();
    std::mt19937 random(seed);
    std::size_t inputs = corpus.size();
    const auto begin = std::chrono::steady_clock::now();
    const std::chrono::duration<double> time(seconds);
    while (std::chrono::steady_clock::now() - begin < time) {
        const Bytes bytes = changed(corpus[random() % corpus.size()], corpus, random);
        std::ofstream(kept, std::ios::binary)
            .write(reinterpret_cast<const char*>(bytes.data()),
                   static_cast<std::streamsize>(bytes.size()));
        LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
        ++inputs;
    }
    std::error_code ignored;
    if (seconds > 0.0) fs::remove(kept, ignored);
    std::printf("%zu inputs answered\n", inputs);
    return 0;
}
