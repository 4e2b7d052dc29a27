// SPDX-License-Identifier: Apache-2.0
/// \file
/// What a caller asks of a graph: inputs, outputs, parameters, and how to run.
#pragma once

#include "rayloom/core/param.h"
#include "rayloom/image/deep.h"
#include "rayloom/image/image_desc.h"
#include "rayloom/image/view.h"

#include <OpenImageIO/imagebuf.h>

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

namespace rayloom
{

/// Pixels in memory with their description.
struct MemoryImage {
    ImageDesc desc;
    ImageBuffer pixels; ///< region() == desc.data, as many channels as desc names
};

/// Deep pixels in memory with their description.
struct MemoryDeep {
    ImageDesc desc;
    std::vector<std::shared_ptr<const DeepRow>> rows; ///< from desc.data.y0 on, of its whole width
};

/// Copies an ImageBuf (any pixel type, not deep) into planar float. Throws InputError when the
/// ImageBuf holds an error or no pixels.
MemoryImage to_memory_image(const OIIO::ImageBuf& buffer);
/// The reverse: an interleaved float ImageBuf with the same windows, names and metadata.
OIIO::ImageBuf to_image_buf(const MemoryImage& image);

/// One file of a graph input.
struct InputFile {
    std::string path;
    std::string
        layer; ///< layer or part name; empty lets the graph's role and the renderer map choose
};

/// What a graph input is bound to: files, or images in memory.
struct InputBinding {
    std::vector<InputFile> files;
    std::vector<std::shared_ptr<const MemoryImage>> images;
    std::shared_ptr<const MemoryDeep> deep; ///< for an input of kind deep
    bool is_list = false; ///< several files or images, or one that is still meant as a list
};

/// Where a graph output goes. Without a path the pixels are kept (RunReport::images, deep).
struct OutputBinding {
    std::string path;
    std::string type;              ///< "half", "float", "uint8", …; empty: as the input had
    std::string compression;       ///< empty: as the input had
    std::string layer;             ///< written as `layer.channel`; empty: plain names
    std::string pass_through_from; ///< file whose other layers are written too, bit for bit
};

struct RunRequest {
    std::map<std::string, InputBinding, std::less<>> inputs;
    /// Requested outputs; empty asks for every output, kept in memory.
    std::map<std::string, OutputBinding, std::less<>> outputs;
    /// As typed on a command line.
    std::map<std::string, std::string, std::less<>> param_texts;
    std::map<std::string, ParamValue, std::less<>> params;
    std::optional<Region> roi; ///< compute only these pixels of the outputs
};

/// How to run; none of it changes a pixel.
struct RunOptions {
    int threads = 0;          ///< 0: as many as the process may use
    std::size_t memory = 0;   ///< budget in bytes for pixels; 0: no limit
    int tile = 0;             ///< tile side in pixels; 0: chosen by the engine
    bool skip = true;         ///< false: take no shortcut
    std::string cache_folder; ///< empty: no cache
    std::stop_token stop;     ///< asks the run to end with Cancelled
    /// Called with the share of the work done, 0 to 1, from one thread at a time.
    std::function<void(double)> progress;
};

} // namespace rayloom
